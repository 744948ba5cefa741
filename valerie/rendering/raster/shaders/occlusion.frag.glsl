// Ambient occlusion from the depth map: McGuire et al. 2011, "The Alchemy screen-space ambient obscurance algorithm"
// (doi:10.1145/2018323.2018327). One value per pixel, at its first sample. A tap at ``radius`` or farther has weight 0 exactly,
// which bounds the layer's rectangle.
#include "disc.glsl"
#include "octahedron.glsl"
#include "sample.glsl"
uniform sampler2D normals_map;
uniform float radius;          // metres
uniform float largest_radius;  // pixels
uniform float focal;           // pixels
#ifdef MOVABLES
#include "columns.glsl"
#include "contact.glsl"
#endif
layout(location = 0) out float out_open;
const int TAPS = 12;

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    ivec2 s = pixel * 2;
    float window = texelFetch(depth_map, s, 0).r;
    out_open = 1.0;
    if (window == 1.0) return;
    float depth = linear_depth(window);
    vec3 p = ray_of(s) * depth;
    vec3 normal = octahedron_decode(texelFetch(normals_map, s, 0).zw);
    float reach = clamp(radius * focal / depth, 1.5, largest_radius);
    // The noise repeats every 4 × 4 pixels, the size of the blur (blur.frag).
    float turn = gradient_noise(vec2(pixel % 4)) * 6.2831853;
    vec2 way = direction(turn);
    float sum = 0.0;
    for (int i = 0; i < TAPS; ++i) {
        float along = (float(i) + 0.5) / float(TAPS);
        ivec2 tap = pixel + ivec2(floor(way * (along * reach) + 0.5));
        way = GOLDEN * way;
        tap = clamp(tap, ivec2(0), sample_size / 2 - 1) * 2;
        vec3 v = ray_of(tap) * linear_depth(texelFetch(depth_map, tap, 0).r) - p;
        float near = max(1.0 - dot(v, v) / (radius * radius), 0.0);
        sum += near * near * near * max(dot(v, normal) - 0.002 * depth, 0.0) / (dot(v, v) + 0.01 * radius);
    }
    out_open = max(0.0, 1.0 - sum * 2.2 / float(TAPS) * sqrt(radius));
#ifdef MOVABLES
    out_open *= open_beside_movables(eye + p, normal, direction(turn), fract(7.0 * turn / 6.2831853));
#endif
}
