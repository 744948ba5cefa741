// Mean of those of the 4 × 4 pixels around that lie on the same surface.
#include "sample.glsl"
uniform sampler2D noisy;
layout(location = 0) out float out_open;

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    float depth = linear_depth(texelFetch(depth_map, pixel * 2, 0).r);
    float sum = 0.0, weights = 0.0;
    for (int y = -2; y < 2; ++y) {
        for (int x = -2; x < 2; ++x) {
            ivec2 tap = clamp(pixel + ivec2(x, y), ivec2(0), sample_size / 2 - 1);
            float other = linear_depth(texelFetch(depth_map, tap * 2, 0).r);
            float weight = max(1e-4, 1.0 - abs(other - depth) / (0.02 * depth + 0.02));
            sum += weight * texelFetch(noisy, tap, 0).r;
            weights += weight;
        }
    }
    out_open = sum / weights;
}
