// Contact shadows: the share of the sky's light that movables leave to a level surface of the statics close to them. The map of
// the movables from below has the lowest of each column. A column hides elevations from there to HEIGHT above the surface; of
// light that is even and weighted by the cosine, sin² of the highest less sin² of the lowest. Beyond ``contact_reach`` there is
// no effect at all, which bounds the layer's rectangle.
uniform sampler2D soles;
uniform vec3 soles_origin;     // low corner of the map's box, metres
uniform vec3 soles_extent;
uniform vec2 contact_reach;    // across, and up or down, metres
const int CONTACT_WAYS = 6, CONTACT_STEPS = 6;
const float HEIGHT = 1.5;      // of a person or a car, metres
const float ITSELF = 0.03;     // a movable so much lower than a surface is the surface's own, metres
const vec2 LEVEL = vec2(0.5, 0.9);

// Height of the lowest movable at a place; very large without one.
float sole(vec2 at) {
    vec2 t = (at - soles_origin.xy) / soles_extent.xy;
    ivec2 size = textureSize(soles, 0);
    float depth = texelFetch(soles, clamp(ivec2(t * vec2(size)), ivec2(0), size - 1), 0).r;
    bool inside = all(greaterThan(t, vec2(0.0))) && all(lessThan(t, vec2(1.0)));
    return inside && depth < 1.0 ? soles_origin.z + depth * soles_extent.z : 1e9;
}

// ``way`` is any direction, and ``phase`` any number in [0, 1).
float open_beside_movables(vec3 p, vec3 normal, vec2 way, float phase) {
    float level = sole(p.xy) < p.z - ITSELF ? 0.0 : smoothstep(LEVEL.x, LEVEL.y, normal.z);
    const float TURN = 6.2831853 / float(CONTACT_WAYS);
    const mat2 NEXT = mat2(cos(TURN), sin(TURN), -sin(TURN), cos(TURN));
    float sum = 0.0;
    int i = 0, ways = level > 0.0 ? CONTACT_WAYS : 1;
    do {
        float lowest = 1.0, highest = 0.0, weight = 0.0;
        for (int k = 0; k < CONTACT_STEPS; ++k) {
            float share = (float(k) + phase) / float(CONTACT_STEPS);
            float along = contact_reach.x * share * share;
            float above = sole(p.xy + way * along) - p.z;
            float near = (1.0 - pow(share, 8.0)) * (1.0 - smoothstep(0.5, 1.0, abs(above) / contact_reach.y));
            float rise = max(above, 0.0);
            lowest = near > 0.0 ? min(lowest, rise * rise / (rise * rise + along * along + 1e-6)) : lowest;
            highest = near > 0.0 ? max(highest, HEIGHT * HEIGHT / (HEIGHT * HEIGHT + along * along)) : highest;
            weight = max(weight, near);
        }
        sum += weight * max(highest - lowest, 0.0);
        way = NEXT * way;
    } while (++i < ways);
    return 1.0 - level * sum / float(CONTACT_WAYS);
}
