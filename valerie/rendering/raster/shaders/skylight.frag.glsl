// Light of the sky and of the surfaces that hide it, as spherical harmonics, from the openness of each direction (openness.frag).
// It is linear in the openness: the weights are the sky's light in each direction minus that of the hiding surfaces
// (surroundings.py). The light of near surfaces is added as its difference from the scene's (nearby.py).
#include "octahedron.glsl"
#include "sample.glsl"
uniform sampler2D normals_map;
uniform usampler2D first;
uniform usampler2D second;
uniform sampler3D near;                        // four layers: red, green and blue above; light below
uniform vec3 near_low;
uniform vec3 near_size;
uniform vec4 hidden[7];                        // sums where no direction is open: red, green, blue, zonal; three of moments
uniform vec4 weights[7 * 32];                  // increments of the sums per step of openness
layout(location = 0) out vec4 out_red;         // mean, x, y, z
layout(location = 1) out vec4 out_green;
layout(location = 2) out vec4 out_blue;
layout(location = 3) out vec4 out_zonal;       // zonal parts of order 2 of red, green and blue

// Unrolled instead of a loop: with a constant index, all lanes share one weight.
#define OPEN(K, STEPS) { \
    float open = float((STEPS) & 255u); \
    out_red += open * weights[7 * (K)]; \
    out_green += open * weights[7 * (K) + 1]; \
    out_blue += open * weights[7 * (K) + 2]; \
    out_zonal += open * weights[7 * (K) + 3]; \
    first_moments += open * weights[7 * (K) + 4]; \
    second_moments += open * weights[7 * (K) + 5]; \
    last_moments += open * weights[7 * (K) + 6]; \
}
#define FOUR(K, NUMBER) OPEN(K, NUMBER) OPEN(K + 1, NUMBER >> 8) OPEN(K + 2, NUMBER >> 16) OPEN(K + 3, NUMBER >> 24)

// Distance from a surface at which its surroundings are looked up, metres. The cells of the grid are several metres wide.
const float NEAR_AHEAD = 1.0;

// Texels of the layers of ``near`` at a place of the world.
mat4 near_light(vec3 p) {
    vec3 cells = vec3(textureSize(near, 0)) / vec3(1.0, 1.0, 4.0);
    vec3 at = clamp((p - near_low) / near_size * cells, vec3(0.5), cells - 0.5);
    vec3 layers = cells * vec3(1.0, 1.0, 4.0);
    mat4 light;
    for (int i = 0; i < 4; ++i) light[i] = textureLod(near, (at + vec3(0.0, 0.0, float(i) * cells.z)) / layers, 0.0);
    return light;
}

void main() {
    ivec2 cell = ivec2(gl_FragCoord.xy), s = cell * SKYLIGHT_CELL;
    uvec4 one = texelFetch(first, cell, 0), two = texelFetch(second, cell, 0);
    vec4 first_moments = hidden[4], second_moments = hidden[5], last_moments = hidden[6];
    out_red = hidden[0];
    out_green = hidden[1];
    out_blue = hidden[2];
    out_zonal = hidden[3];
    FOUR(0, one.x)
    FOUR(4, one.y)
    FOUR(8, one.z)
    FOUR(12, one.w)
    FOUR(16, two.x)
    FOUR(20, two.y)
    FOUR(24, two.z)
    FOUR(28, two.w)
    float window = texelFetch(depth_map, s, 0).r;
    vec3 normal = octahedron_decode(texelFetch(normals_map, s, 0).zw);
    mat4 light = near_light(eye + ray_of(s) * linear_depth(window) + normal * NEAR_AHEAD);
    // A linear function of the direction, 1, x, y, z, times the harmonics, summed over the hidden directions.
    vec4 zz = vec4(first_moments.x - second_moments.x - second_moments.w, last_moments.yzw);
    mat4 moments = mat4(
        first_moments,
        vec4(first_moments.y, second_moments.xyz),
        vec4(first_moments.z, second_moments.y, second_moments.w, last_moments.x),
        vec4(first_moments.w, second_moments.z, last_moments.x, zz.x));
    const vec4 SCALE = vec4(1.0, 3.0, 3.0, 3.0), BELOW = vec4(0.5, 0.0, 0.0, -0.75);  // as `sky_weights` and `from_below`
    out_red += SCALE * (moments * light[0]) + BELOW * light[3].r;
    out_green += SCALE * (moments * light[1]) + BELOW * light[3].g;
    out_blue += SCALE * (moments * light[2]) + BELOW * light[3].b;
    out_zonal += (7.5 * zz - 2.5 * first_moments) * light;
    out_zonal.w = 0.0;
    // There is no light where nothing was drawn.
    float drawn = window == 1.0 ? 0.0 : 1.0;
    out_red *= drawn;
    out_green *= drawn;
    out_blue *= drawn;
    out_zonal *= drawn;
}
