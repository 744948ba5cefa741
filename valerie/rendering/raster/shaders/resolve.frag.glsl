// Resolves two by two samples per pixel: a tent of one pixel radius, (1 3 3 1) / 8 in each direction, averages light like a lens
// and a sensor with an optical low-pass filter. All samples of a plain pixel have its radiance.
uniform sampler2D radiance;
uniform sampler2D plain_radiance;            // 1 in its last channel where a pixel is plain
layout(location = 0) out vec4 out_color;

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy), last = textureSize(plain_radiance, 0) - 1;
    vec3 sum = vec3(0.0);
    int detailed = 0;                        // a bit for each pixel around that is not plain
    for (int y = 0; y < 3; ++y) {
        for (int x = 0; x < 3; ++x) {
            vec4 color = texelFetch(plain_radiance, clamp(pixel + ivec2(x, y) - 1, ivec2(0), last), 0);
            float weight = (x == 1 ? 6.0 : 1.0) * (y == 1 ? 6.0 : 1.0) / 64.0;
            sum += color.a > 0.0 ? weight * color.rgb : vec3(0.0);
            detailed |= color.a > 0.0 ? 0 : 1 << (3 * y + x);
        }
    }
    ivec2 first = pixel * 2 - 1;
    int samples = detailed != 0 ? 16 : 0;
    for (int i = 0; i < samples; ++i) {
        int x = i & 3, y = i >> 2;
        float weight = (x == 1 || x == 2 ? 3.0 : 1.0) * (y == 1 || y == 2 ? 3.0 : 1.0) / 64.0;
        bool wanted = (detailed >> (3 * ((y + 1) >> 1) + ((x + 1) >> 1)) & 1) != 0;
        vec3 color = texelFetch(radiance, clamp(first + ivec2(x, y), ivec2(0), 2 * last + 1), 0).rgb;
        sum += wanted ? weight * color : vec3(0.0);
    }
    out_color = vec4(sum, 1.0);
}
