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

// Alpha is read at full detail at any distance: the mean of bars and gaps would cut both or neither. Drivers may filter
// textureLod anisotropically, over more than the place asked for.
void cut_by_alpha() {
    int layer = int(material_texel(3).x), last = textureSize(color_textures, 0).x - 1;
    vec2 at = fract(uv) * float(last + 1) - 0.5, part = fract(at);
    ivec2 low = ivec2(floor(at)) & last, high = (low + 1) & last;
    vec4 alpha = vec4(
        texelFetch(color_textures, ivec3(low, layer), 0).a, texelFetch(color_textures, ivec3(high.x, low.y, layer), 0).a,
        texelFetch(color_textures, ivec3(low.x, high.y, layer), 0).a, texelFetch(color_textures, ivec3(high, layer), 0).a);
    vec2 row = mix(alpha.xz, alpha.yw, part.x);
    if (mix(row.x, row.y, part.y) < material_texel(0).a) discard;
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
