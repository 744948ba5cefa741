// Smooth random surfaces, for what lies on the ground.

// Height of a smooth random surface in [0, 1] with cells of unit length, and its slopes along x and y.
vec3 relief(vec2 p, float layer) {
    vec2 cell = floor(p), t = p - cell;
    vec2 s = t * t * (3.0 - 2.0 * t), slope = 6.0 * t * (1.0 - t);
    float a = random_of(vec3(cell, layer)), b = random_of(vec3(cell + vec2(1.0, 0.0), layer));
    float c = random_of(vec3(cell + vec2(0.0, 1.0), layer)), d = random_of(vec3(cell + 1.0, layer));
    float twist = a - b - c + d;
    return vec3(a + (b - a) * s.x + (c - a) * s.y + twist * s.x * s.y, slope * (vec2(b, c) - a + twist * s.yx));
}

// Metres of ground that a pixel at p covers along the view: details shorter than that are replaced by their mean.
float grain_of(float depth, float facing) {
    return 4.0 * depth * length(ray_basis[1]) / float(sample_size.y) / max(facing, 0.05);
}

float seen(float length_of, float grain) {
    return 1.0 - smoothstep(0.25 * length_of, length_of, grain);
}
