// Texturing of the movables' visible samples: writes base colour and shading normal to the G-buffer.
#include "octahedron.glsl"
#include "roughness.glsl"
uniform sampler2D uv_map;
uniform sampler2D frame_map;
uniform usampler2D row_map;
uniform sampler2D material_table;
layout(location = 0) out vec4 out_albedo;
layout(location = 1) out vec4 out_normals;
layout(location = 2) out uvec2 out_material;

// There is one texture array per side, a power of two. Each use has the sum of the sides that occur in the frame, since a CPU
// rasteriser reads all arrays of a use for every sample.
#define SIDES (COLOR_SIDES | NORMAL_SIDES | ROUGHNESS_SIDES)
#if SIDES & 64
uniform sampler2DArray textures_64;
#endif
#if SIDES & 128
uniform sampler2DArray textures_128;
#endif
#if SIDES & 256
uniform sampler2DArray textures_256;
#endif
#if SIDES & 512
uniform sampler2DArray textures_512;
#endif
#if SIDES & 1024
uniform sampler2DArray textures_1024;
#endif
#if SIDES & 2048
uniform sampler2DArray textures_2048;
#endif

#define READ(SIDE) if ((sides & SIDE) != 0 && side == SIDE) \
    color = textureLod(textures_##SIDE, vec3(uv, layer), level + log2(float(SIDE)));
vec4 texel(const int sides, int side, float layer, vec2 uv, float level) {
    vec4 color = vec4(1.0);
#if SIDES & 64
    READ(64)
#endif
#if SIDES & 128
    READ(128)
#endif
#if SIDES & 256
    READ(256)
#endif
#if SIDES & 512
    READ(512)
#endif
#if SIDES & 1024
    READ(1024)
#endif
#if SIDES & 2048
    READ(2048)
#endif
    return color;
}

vec3 linear_from_srgb(vec3 c) {
    return mix(c / 12.92, pow((c + 0.055) / 1.055, vec3(2.4)), step(0.04045, c));
}

void main() {
    ivec2 s = ivec2(gl_FragCoord.xy);
    uvec2 stored = texelFetch(row_map, s, 0).rg;
    bool moving = stored.x > 0u;
    int row = moving ? int(stored.x) - 1 : 0;
    vec4 places = moving ? texelFetch(material_table, ivec2(3, row), 0) : vec4(0.0);
    vec2 uv = texelFetch(uv_map, s, 0).rg;
    float packed_level = unpackHalf2x16(stored.y).x;
    float level = abs(packed_level) - 32.0;
    vec3 color = texelFetch(material_table, ivec2(0, row), 0).rgb;
    color *= linear_from_srgb(texel(COLOR_SIDES, int(places.z), places.x, uv, level).rgb);
    vec4 frame = texelFetch(frame_map, s, 0);
    vec3 normal = octahedron_decode(frame.xy), shading = normal;
    int side = int(places.w);
    if (side > 0) {
        // In glTF v grows downwards and the map's +y points upwards in the image.
        vec3 tangent = octahedron_decode(frame.zw);
        vec3 bitangent = cross(normal, tangent) * (packed_level < 0.0 ? 1.0 : -1.0);
        vec3 t = texel(NORMAL_SIDES, side, places.y, uv, level).xyz * 2.0 - 1.0;
        shading = normalize(mat3(tangent, bitangent, normal) * t);
    }
    vec4 more = moving ? texelFetch(material_table, ivec2(4, row), 0) : vec4(0.0);
    vec2 factors = texel(ROUGHNESS_SIDES, int(more.z), more.y, uv, level).gb;
    // Discarded last, since llvmpipe's loops do not stop for lanes discarded earlier.
    if (!moving) discard;
    out_albedo = vec4(sqrt(color), 1.0);
    out_normals = vec4(octahedron_encode(shading), frame.xy);
    out_material = uvec2(row, packed_factors(factors));
}
