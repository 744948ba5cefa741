// The G-buffer of plain pixels, which are lit once. A pixel is plain if its 2 × 2 samples show one nearly flat surface, or only
// sky.
#include "octahedron.glsl"
#include "sample.glsl"
#include "roughness.glsl"
uniform sampler2D albedo_map;
uniform sampler2D normals_map;
uniform usampler2D material_map;
layout(location = 0) out vec4 out_albedo;    // square root of the mean linear colour; 1 where the pixel is plain
layout(location = 1) out vec4 out_normals;   // as in the G-buffer
layout(location = 2) out uvec2 out_material;
layout(location = 3) out float out_depth;    // window depth of the pixel's centre

// Largest differences within a plain pixel: of depth, as a share of the distance, and of unit normals.
const float DEPTHS = 0.03;
const float FACES = 0.1;
const float BUMPS = 0.25;

void main() {
    ivec2 s = ivec2(gl_FragCoord.xy) * 2;
    vec4 window = vec4(
        texelFetch(depth_map, s, 0).r, texelFetch(depth_map, s + ivec2(1, 0), 0).r,
        texelFetch(depth_map, s + ivec2(0, 1), 0).r, texelFetch(depth_map, s + 1, 0).r);
    uvec2 material = texelFetch(material_map, s, 0).rg, factors = uvec2(0u);
    vec3 color = vec3(0.0), bumps[4], faces[4];
    bool one = true;
    for (int i = 0; i < 4; ++i) {
        ivec2 at = s + ivec2(i & 1, i >> 1);
        vec3 root = texelFetch(albedo_map, at, 0).rgb;
        color += root * root;
        vec4 normals = texelFetch(normals_map, at, 0);
        bumps[i] = octahedron_point(normals.xy);
        faces[i] = octahedron_point(normals.zw);
        uvec2 other = texelFetch(material_map, at, 0).rg;
        one = one && other.x == material.x;
        factors += uvec2(other.y & 0xffu, other.y >> 8u);
    }
    vec3 bump = (bumps[0] + bumps[1] + bumps[2] + bumps[3]) * 0.25;
    vec3 face = (faces[0] + faces[1] + faces[2] + faces[3]) * 0.25;
    float bent = 0.0, rough = 0.0;
    for (int i = 0; i < 4; ++i) {
        vec3 b = bumps[i] - bump, f = faces[i] - face;
        rough = max(rough, dot(b, b));
        bent = max(bent, dot(f, f));
    }
    // Inverse depth is linear over the image and in window depth.
    vec4 near = near_far.x * window + near_far.y * (1.0 - window);
    float nearest = max(max(near.x, near.y), max(near.z, near.w)), farthest = min(min(near.x, near.y), min(near.z, near.w));
    one = one && nearest - farthest < DEPTHS * nearest && bent < FACES * FACES * dot(face, face)
        && rough < BUMPS * BUMPS * dot(bump, bump) && all(lessThan(window, vec4(1.0)));
    bool plain = one || all(equal(window, vec4(1.0)));
    out_albedo = vec4(sqrt(color * 0.25), plain ? 1.0 : 0.0);
    out_normals = vec4(octahedron_encode(bump), octahedron_encode(face));
    factors = (factors + 2u) / 4u;
    out_material = uvec2(material.x, factors.x | factors.y << 8u);
    out_depth = dot(window, vec4(0.25));
}
