// A movable's sample before texturing. Textures are read later, once per visible sample (texturing.frag): movables have many
// triangles smaller than the block of fragments that a driver shades together, so a texture read here would cost ten times as
// much.
#include "octahedron.glsl"
#include "surface.glsl"
layout(location = 0) out vec2 out_uv;
layout(location = 1) out vec4 out_frame;     // octahedral: interpolated normal, tangent (u's direction)
layout(location = 2) out uvec2 out_material; // row of the material table + 1; binary logarithm of a step in uv + 32,
                                             // negative where u, v and the normal are left-handed

void main() {
#ifdef CLEAR
    see_through();
#endif
#ifdef CUT
    cut_by_alpha();
#endif
    vec3 normal = normalize(world_normal);
    if (!gl_FrontFacing) normal = -normal;
    vec2 frame = octahedron_encode(normal);
    out_uv = uv;
    out_frame = vec4(frame, frame);
    uint footprint = 0u;
#ifdef TEXTURED
    vec2 du = dFdx(uv), dv = dFdy(uv);
    // The mean side of the footprint suffices, since a pixel has several samples along the longer side.
    float level = 0.5 * log2(max(length(du) * length(dv), 1e-12)) + 32.0;
#ifdef NORMAL_TEXTURE
    // Tangent frame from screen derivatives (Schueler 2013, "Normal mapping without precomputed tangents", GPU Pro 4).
    vec3 across = cross(dFdy(world_position), normal) * du.x + cross(normal, dFdx(world_position)) * dv.x;
    if (dot(across, across) > 1e-24) out_frame.zw = octahedron_encode(normalize(across));
    if (du.x * dv.y < du.y * dv.x) level = -level;
#endif
    footprint = packHalf2x16(vec2(level, 0.0)) & 0xffffu;
#endif
    out_material = uvec2(material_row + 1u, footprint);
}
