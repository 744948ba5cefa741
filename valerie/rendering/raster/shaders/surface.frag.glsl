// The G-buffer: the inputs of the lighting at each sample.
#include "octahedron.glsl"
#include "surface.glsl"
layout(location = 0) out vec4 out_albedo;    // square root of the linear base colour
layout(location = 1) out vec4 out_normals;   // octahedral: shading normal, interpolated normal
layout(location = 2) out uvec2 out_material; // row of the material table; texel of its roughness texture (roughness.glsl)
#include "roughness.glsl"
#ifdef NORMAL_TEXTURE
uniform sampler2DArray normal_textures;
#endif
#ifdef ROUGHNESS_TEXTURE
uniform sampler2DArray roughness_textures;
#endif
#ifdef ROOM_CELLS
#include "rooms.glsl"
#endif

vec3 linear_from_srgb(vec3 c) {
    return mix(c / 12.92, pow((c + 0.055) / 1.055, vec3(2.4)), step(0.04045, c));
}

void main() {
#ifdef CLEAR
    see_through();
#endif
    vec3 color = material_texel(0).rgb;
    vec2 du = dFdx(uv), dv = dFdy(uv);
#ifdef CUT
    // Thin parts keep their colour with anisotropic filters.
    float slant = 0.0;
#else
    // On elongated footprints, textures are read at a finer mip level than the longer side needs. The pixel's other samples cover
    // the gaps, which is far cheaper on a CPU than anisotropic filters.
    float wide = dot(du, du), high = dot(dv, dv);
    float slant = 0.5 * log2(max(wide, high) / max(min(wide, high), 1e-20));
#endif
#if defined(COLOR_TEXTURE) && !defined(ROOM_CELLS)
#ifdef CUT
    cut_by_alpha();
    vec4 texel = texture(color_textures, vec3(uv, material_texel(3).x));
#else
    // Two taps along the longer side.
    vec3 along = vec3((wide > high ? du : dv) * 0.25, 0.0), at = vec3(uv, material_texel(3).x);
    float level = -min(slant, 1.6);
    vec4 texel = 0.5 * (texture(color_textures, at + along, level) + texture(color_textures, at - along, level));
#endif
    color *= linear_from_srgb(texel.rgb);
#endif
    vec3 normal = normalize(world_normal);
    if (!gl_FrontFacing) normal = -normal;
    vec3 shading = normal;
#ifdef NORMAL_TEXTURE
    // Tangent frame from screen derivatives (Schueler 2013, "Normal mapping without precomputed tangents", GPU Pro 4).
    // In glTF v grows downwards and the map's +y points upwards in the image.
    vec3 dx = dFdx(world_position), dy = dFdy(world_position);
    vec3 across_x = cross(dy, normal), across_y = cross(normal, dx);
    vec3 tangent = across_x * du.x + across_y * dv.x;
    vec3 bitangent = -(across_x * du.y + across_y * dv.y);
    float largest = max(dot(tangent, tangent), dot(bitangent, bitangent));
    if (largest > 1e-24) {
        vec3 t = texture(normal_textures, vec3(uv, material_texel(3).y), -min(slant, 1.0)).xyz * 2.0 - 1.0;
        shading = normalize(mat3(tangent * inversesqrt(largest), bitangent * inversesqrt(largest), normal) * t);
    }
#endif
    uint factors = NO_ROUGHNESS_TEXTURE;
#ifdef ROOM_CELLS
    vec4 room = behind_pane(normal, du, dv, slant, shading);
    color *= linear_from_srgb(room.rgb);
    factors = packed_factors(vec2(1.0, room.a));
#endif
    out_albedo = vec4(sqrt(color), 1.0);
    out_normals = vec4(octahedron_encode(shading), octahedron_encode(normal));
#ifdef ROUGHNESS_TEXTURE
    factors = packed_factors(texture(roughness_textures, vec3(uv, material_texel(4).y), -min(slant, 1.0)).gb);
#endif
    out_material = uvec2(material_row, factors);
}
