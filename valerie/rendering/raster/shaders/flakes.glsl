// Snowflakes in front of the camera: layers of cells at increasing distances, each with at most one flake. The pattern is fixed in
// the image, so that background and layer of a frame agree. snowfall.py has the same pattern for other engines, and the numbers.
uniform float flakes;               // chance of a flake in a cell
uniform vec3 flake_light;           // radiance of a flake
uniform float focal;                // focal length, samples

float flake(vec2 place) {
    float coverage = 0.0, distance_of = 0.7;
    int layers = flakes > 0.0 ? 7 : 0;
    for (int i = 0; i < layers; ++i) {
        float edge = 0.0632 / sqrt(distance_of);
        vec2 cells = place / focal * (distance_of / edge);
        cells.x += cells.y * 0.35;
        cells.y += random_of(vec3(floor(cells.x), float(i), 17.0));
        vec3 cell = vec3(floor(cells), float(i));
        vec2 centre = 0.35 + 0.3 * vec2(random_of(cell + 5.0), random_of(cell + 9.0));
        float size = random_of(cell + 13.0), radius = 0.0015 + 0.0025 * size * size;
        // Defocus and the size of a sample soften the edge; defocus and the fall during the exposure take opacity.
        float soft = 0.001 * (1.0 - distance_of / 12.0) + 0.5 * distance_of / focal, reach = radius + soft;
        vec2 off = (fract(cells) - centre) * edge;
        off.y -= clamp(off.y, -0.0025, 0.0025);
        float opacity = radius * radius / (reach * reach) * radius / (radius + 0.0025);
        float shape = 1.0 - smoothstep(max(radius - soft, 0.0), reach, length(off));
        coverage = max(coverage, random_of(cell) < flakes ? opacity * shape : 0.0);
        distance_of *= 1.5;
    }
    return coverage;
}

// A colour behind falling snow.
vec3 through_flakes(vec3 color) {
#ifdef PLAIN
    vec2 s = floor(gl_FragCoord.xy) * 2.0 + 0.5;
    float coverage = 0.25 * (flake(s) + flake(s + vec2(1.0, 0.0)) + flake(s + vec2(0.0, 1.0)) + flake(s + 1.0));
#else
    float coverage = flake(gl_FragCoord.xy);
#endif
    return mix(color, flake_light, coverage);
}
