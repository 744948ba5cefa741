// Light of the sky and of the surfaces that hide it, as spherical harmonics, from the openness of each direction (openness.frag).
// It is linear in the openness: the weights are the sky's light in each direction minus that of the hiding surfaces
// (surroundings.py).
#include "sample.glsl"
uniform usampler2D first;
uniform usampler2D second;
uniform vec4 hidden[4];                        // sums where no direction is open: red, green, blue, zonal
uniform vec4 weights[4 * 32];                  // increments of the sums per step of openness
layout(location = 0) out vec4 out_red;         // mean, x, y, z
layout(location = 1) out vec4 out_green;
layout(location = 2) out vec4 out_blue;
layout(location = 3) out vec4 out_zonal;       // zonal parts of order 2 of red, green and blue

// Unrolled instead of a loop: with a constant index, all lanes share one weight.
#define OPEN(K, STEPS) { \
    float open = float((STEPS) & 255u); \
    out_red += open * weights[4 * (K)]; \
    out_green += open * weights[4 * (K) + 1]; \
    out_blue += open * weights[4 * (K) + 2]; \
    out_zonal += open * weights[4 * (K) + 3]; \
}
#define FOUR(K, NUMBER) OPEN(K, NUMBER) OPEN(K + 1, NUMBER >> 8) OPEN(K + 2, NUMBER >> 16) OPEN(K + 3, NUMBER >> 24)

void main() {
    ivec2 cell = ivec2(gl_FragCoord.xy);
    uvec4 near = texelFetch(first, cell, 0), far = texelFetch(second, cell, 0);
    out_red = hidden[0];
    out_green = hidden[1];
    out_blue = hidden[2];
    out_zonal = hidden[3];
    FOUR(0, near.x)
    FOUR(4, near.y)
    FOUR(8, near.z)
    FOUR(12, near.w)
    FOUR(16, far.x)
    FOUR(20, far.y)
    FOUR(24, far.z)
    FOUR(28, far.w)
    // There is no light where nothing was drawn.
    float drawn = texelFetch(depth_map, cell * SKYLIGHT_CELL, 0).r == 1.0 ? 0.0 : 1.0;
    out_red *= drawn;
    out_green *= drawn;
    out_blue *= drawn;
    out_zonal *= drawn;
}
