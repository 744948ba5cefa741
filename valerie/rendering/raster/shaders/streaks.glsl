// Rain streaks in the air.
uniform float drops;                // share of the image that rain streaks cross
uniform int pixel_height;           // height of the image, pixels

// Coverage of a sample by rain streaks: layers of cells, each with at most one drop, stretched by its fall during the exposure.
// The pattern is fixed in the image, so that background and layer of a frame agree. rain.py has the same pattern for other
// engines.
float streak(vec2 place) {
    vec2 at = place / float(pixel_height);
    float coverage = 0.0;
    int i = 0, layers = drops > 0.0 ? 4 : 1;
    do {
        float finer = 1.0 + 0.7 * float(i);
        vec2 cells = at * vec2(30.0, 5.0) * finer;
        cells.x += cells.y * 0.12;
        cells.y += random_of(vec3(floor(cells.x), float(i), 7.0));
        vec3 cell = vec3(floor(cells), float(i));
        vec2 inside = fract(cells);
        float centre = 0.15 + 0.7 * random_of(cell + 11.0);
        float thin = 1.0 - smoothstep(0.0, 0.035, abs(inside.x - centre));
        float long_side = smoothstep(0.0, 0.3, inside.y) * (1.0 - smoothstep(0.5, 0.9, inside.y));
        coverage = max(coverage, random_of(cell) < drops * 1.6 ? thin * long_side / finer : 0.0);
    } while (++i < layers);
    return coverage;
}

// A colour behind rain. A drop refracts a wide field of its surroundings, so it shows the haze.
vec3 through_rain(vec3 color) {
#ifdef PLAIN
    // Streaks are thinner than a pixel, so it takes the mean over its samples.
    vec2 s = floor(gl_FragCoord.xy) * 2.0 + 0.5;
    float coverage = 0.25 * (streak(s) + streak(s + vec2(1.0, 0.0)) + streak(s + vec2(0.0, 1.0)) + streak(s + 1.0));
#else
    float coverage = streak(gl_FragCoord.xy);
#endif
    return drops > 0.0 ? mix(color, haze, 0.3 * coverage) : color;
}
