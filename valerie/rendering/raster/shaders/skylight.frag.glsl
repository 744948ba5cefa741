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

// Openness of four directions, in steps of 1/255.
vec4 open_of(uint number) {
    return vec4(number & 255u, number >> 8 & 255u, number >> 16 & 255u, number >> 24);
}

// Unrolled instead of a loop: with a constant index, all lanes share one weight.
#define FOUR(SUM, OPEN, AT) \
    SUM += OPEN.x * weights[AT]; SUM += OPEN.y * weights[AT + 7]; SUM += OPEN.z * weights[AT + 14]; SUM += OPEN.w * weights[AT + 21];
// LLVM's time for a block grows with the square of its length, so each sum has a block of its own. The compiler must not know that
// the loop has one turn.
#define ADD(SUM, N) i = 0; do { \
    FOUR(SUM, a, N) FOUR(SUM, b, N + 28) FOUR(SUM, c, N + 56) FOUR(SUM, d, N + 84) \
    FOUR(SUM, e, N + 112) FOUR(SUM, f, N + 140) FOUR(SUM, g, N + 168) FOUR(SUM, h, N + 196) \
} while (++i < turns);

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
    float window = texelFetch(depth_map, s, 0).r;
    uvec4 one = texelFetch(first, cell, 0), two = texelFetch(second, cell, 0);
    vec4 a = open_of(one.x), b = open_of(one.y), c = open_of(one.z), d = open_of(one.w);
    vec4 e = open_of(two.x), f = open_of(two.y), g = open_of(two.z), h = open_of(two.w);
    vec4 first_moments = hidden[4], second_moments = hidden[5], last_moments = hidden[6];
    out_red = hidden[0];
    out_green = hidden[1];
    out_blue = hidden[2];
    out_zonal = hidden[3];
    int i, turns = window == 1.0 ? 0 : 1;
    ADD(out_red, 0)
    ADD(out_green, 1)
    ADD(out_blue, 2)
    ADD(out_zonal, 3)
    ADD(first_moments, 4)
    ADD(second_moments, 5)
    ADD(last_moments, 6)
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
