// Inputs of a surface's fragment shader; MOVABLE and texture switches as in the vertex shader.
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

#ifdef CLEAR
// A pane covers some of a pixel's 2 × 2 samples; the background shows in the others. The resolve filter blends them, exactly for
// a share of one half and within 7 % of the difference for others. The pattern is mirrored in every other column of cells.
// Otherwise the first sample of a cell, which represents the cell in coarser maps, would always be the pane's.
void see_through() {
    ivec2 s = ivec2(gl_FragCoord.xy);
    int x = (s.x ^ (s.x / 4)) & 1, y = s.y & 1;
    float share = (float(x == y ? y : 3 - y) + 0.5) / 4.0;
    if (share < material_texel(4).x) discard;
}
#endif
