// Reflections of the panorama around the camera (spots.py) by smooth surfaces anywhere.
uniform sampler2DArray panorama;    // octahedral, sharp and blurred: radiance, 1 / distance in metres
uniform vec3 panorama_spot;         // where it was taken
uniform float panorama_known;       // 0 while it is being taken

const int CAPTURED_STEPS = 11;
const float CAPTURED_FIRST = 0.4;   // length of the first step, metres
const float CAPTURED_GROWTH = 1.7;  // of each further step
const float OF_SKY = 1e-3;          // inverse distance of the sky in the map, 1/m
const float FARTHEST = 300.0;       // of what hides the sky for certain, metres

vec2 panorama_place(vec3 d) {
    float side = float(textureSize(panorama, 0).x);
    return (octahedron_encode(d) * (side - 2.0) + 1.0) / side;
}

// Radiance at p from direction r. The ray is followed through the distances until it is behind what the spot sees. Where it passes
// far behind a thing, which the spot can not know, it goes on. Where the map shows the sky, other things may hide it from p, so
// ``beyond`` replaces it: the radiance of sky or surfaces that p sees there.
vec3 captured(vec3 p, vec3 r, vec3 beyond, float blur, bool wanted) {
    vec3 from = p - panorama_spot;
    float along = CAPTURED_FIRST, passed = 0.0, last_gap = -1.0, hit = -1.0;
    int i = 0, steps = wanted ? CAPTURED_STEPS : 1;
    do {
        vec3 x = from + along * r;
        float gap = length(x) - 1.0 / max(textureLod(panorama, vec3(panorama_place(x), 0.0), 0.0).a, OF_SKY);
        float span = along - passed;
        bool met = hit < 0.0 && gap > 0.15 + 0.02 * length(x) && gap < 1.5 + span;
        // The surface lies where the gap would be zero.
        hit = met ? passed + span * clamp(last_gap / min(last_gap - gap, -1e-3), 0.0, 1.0) : hit;
        last_gap = min(gap, 0.0);
        passed = along;
        along *= CAPTURED_GROWTH;
    } while (++i < steps);
    vec2 at = panorama_place(from + max(hit < 0.0 ? along : hit, 0.1) * r);
    vec4 seen = mix(textureLod(panorama, vec3(at, 0.0), 0.0), textureLod(panorama, vec3(at, 1.0), 0.0), blur);
    return mix(beyond, seen.rgb, smoothstep(0.0, 1.0, seen.a * FARTHEST));
}
