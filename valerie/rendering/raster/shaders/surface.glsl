// What a fragment shader of a surface reads; MOVABLE and texture switches as in the vertex shader.
in vec3 world_position;
in vec3 world_normal;
in vec2 uv;
in float axis_depth;
flat in uint material_row;
flat in uint label;
flat in uint instance;
uniform sampler2D material_table;

vec4 material_texel(int texel) {
    return texelFetch(material_table, ivec2(texel, int(material_row)), 0);
}

#ifdef COLOR_TEXTURE
uniform sampler2DArray color_textures;

vec4 color_texel() {
    return texture(color_textures, vec3(uv, material_texel(3).x));
}

void cut_by_alpha(float alpha) {
    if (alpha < material_texel(0).a) discard;
}
#endif
