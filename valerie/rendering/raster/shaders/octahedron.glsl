// Unit vectors as two numbers in [0, 1]: the octahedral map (Cigolle et al. 2014, "A survey of efficient representations for
// independent unit vectors", JCGT 3(2)).
vec2 octahedron_encode(vec3 v) {
    vec2 p = v.xy / (abs(v.x) + abs(v.y) + abs(v.z));
    vec2 signs = vec2(p.x >= 0.0 ? 1.0 : -1.0, p.y >= 0.0 ? 1.0 : -1.0);
    if (v.z < 0.0) p = (1.0 - abs(p.yx)) * signs;
    return p * 0.5 + 0.5;
}

// The point of the octahedron in the direction of the vector.
vec3 octahedron_point(vec2 e) {
    vec2 p = e * 2.0 - 1.0;
    vec3 v = vec3(p, 1.0 - abs(p.x) - abs(p.y));
    vec2 signs = vec2(v.x >= 0.0 ? 1.0 : -1.0, v.y >= 0.0 ? 1.0 : -1.0);
    if (v.z < 0.0) v.xy = (1.0 - abs(v.yx)) * signs;
    return v;
}

vec3 octahedron_decode(vec2 e) {
    return normalize(octahedron_point(e));
}
