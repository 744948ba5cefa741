// Two by two samples per pixel to pixels: a tent of one pixel radius, (1 3 3 1) / 8 in each direction, as a lens and a sensor
// with an optical low-pass would average light.
uniform sampler2D radiance;
layout(location = 0) out vec4 out_color;

void main() {
    ivec2 first = ivec2(gl_FragCoord.xy) * 2 - 1;
    ivec2 last = textureSize(radiance, 0) - 1;
    vec3 sum = vec3(0.0);
    for (int y = 0; y < 4; ++y) {
        for (int x = 0; x < 4; ++x) {
            float weight = (x == 1 || x == 2 ? 3.0 : 1.0) * (y == 1 || y == 2 ? 3.0 : 1.0) / 64.0;
            sum += weight * texelFetch(radiance, clamp(first + ivec2(x, y), ivec2(0), last), 0).rgb;
        }
    }
    out_color = vec4(sum, 1.0);
}
