// Contact shadows: the share of the sky's light that movables leave to a level surface of the statics close to them. A column
// hides elevations from its lowest to its highest; of light that is even and weighted by the cosine, sin² of the highest less sin²
// of the lowest. Beyond ``contact_reach`` there is no effect at all, which bounds the layer's rectangle.
uniform vec2 contact_reach;    // across, and up or down, metres
const int CONTACT_WAYS = 6, CONTACT_STEPS = 6;
const float ITSELF = 0.03;     // a movable so much lower than a surface is the surface's own, metres
const vec2 LEVEL = vec2(0.5, 0.9);

// ``way`` is any direction, and ``phase`` any number in [0, 1).
float open_beside_movables(vec3 p, vec3 normal, vec2 way, float phase) {
    float level = column(p.xy).x < p.z - ITSELF ? 0.0 : smoothstep(LEVEL.x, LEVEL.y, normal.z);
    const float TURN = 6.2831853 / float(CONTACT_WAYS);
    const mat2 NEXT = mat2(cos(TURN), sin(TURN), -sin(TURN), cos(TURN));
    float sum = 0.0;
    int i = 0, ways = level > 0.0 ? CONTACT_WAYS : 1;
    do {
        float lowest = 1.0, highest = 0.0, weight = 0.0;
        for (int k = 0; k < CONTACT_STEPS; ++k) {
            float share = (float(k) + phase) / float(CONTACT_STEPS);
            float along = contact_reach.x * share * share;
            vec2 above = column(p.xy + way * along) - p.z;
            float near = (1.0 - pow(share, 8.0)) * (1.0 - smoothstep(0.5, 1.0, abs(above.x) / contact_reach.y));
            vec2 rise = max(above, 0.0), sines = rise * rise / (rise * rise + along * along + 1e-6);
            lowest = near > 0.0 ? min(lowest, sines.x) : lowest;
            highest = near > 0.0 ? max(highest, sines.y) : highest;
            weight = max(weight, near);
        }
        sum += weight * max(highest - lowest, 0.0);
        way = NEXT * way;
    } while (++i < ways);
    return 1.0 - level * sum / float(CONTACT_WAYS);
}
