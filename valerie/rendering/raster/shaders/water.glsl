// Rain water on surfaces that face up. It has no thickness: depth and labels stay those of the surface.
uniform float wetness;              // of surfaces that face up, 0 dry … 1 wet

struct Water {
    float film;                     // share of the surface that is wet
    float pool;                     // share of it that stands in water
    vec2 ripples;                   // slopes of the water
};

// Water at a place. ``soaks`` of what falls sinks in. Water stands in hollows some metres wide and in the ruts that tyres polish,
// and on soil only in the deepest hollows.
Water water_at(vec3 p, vec3 face, float soaks, float roughness, float grain) {
    float film = wetness * smoothstep(0.7, 0.95, face.z);
    vec3 broad = relief(p.xy / 3.1, 40.0), narrow = relief(p.xy / vec2(0.8, 1.1), 41.0), fine = relief(p.xy / 0.06, 42.0);
    float hollow = 0.62 * broad.x + 0.30 * narrow.x + 0.08 * fine.x + 0.10 * (1.0 - smoothstep(0.78, 0.88, roughness));
    float level = 0.72 - 0.14 * wetness + 0.2 * soaks;
    float pool = smoothstep(level - 0.04, level + 0.06, hollow) * smoothstep(0.97, 0.995, face.z);
    return Water(film, pool * film, 0.012 * seen(0.06, grain) * fine.yz);
}
