// Rain water on surfaces that face up, with the constants of surface_constants.py. It has no thickness: depth and labels stay those of the surface.

// Relief below a film that is finer than the image: its slopes, and the share of light that it scatters to all sides. A path
// tracer shows both without these numbers, which were chosen beside it.
const float FILM_SLOPES = 0.1;
const float FILM_SCATTERS = 0.35;

uniform float wetness;              // of surfaces that face up, 0 dry … 1 wet

struct Water {
    float film;                     // share of the surface that is wet
    float pool;                     // share of it that stands in water
    vec2 ripples;                   // slopes of the water
};

// Water at a place. ``soaks`` of what falls sinks in. Water stands in hollows some metres wide and in the ruts that tyres polish,
// and on soil only in the deepest hollows.
Water water_at(vec3 p, vec3 face, float soaks, float roughness, float grain) {
    float film = wetness * smoothstep(WATER_WETS.x, WATER_WETS.y, face.z);
    vec3 broad = relief(p.xy / WATER_BROAD, 40.0), narrow = relief(p.xy / WATER_NARROW, 41.0);
    vec3 fine = relief(p.xy / WATER_FINE, 42.0);
    vec4 weights = WATER_WEIGHTS;
    float rut = 1.0 - smoothstep(WATER_RUTS.x, WATER_RUTS.y, roughness);
    float hollow = weights.x * broad.x + weights.y * narrow.x + weights.z * fine.x + weights.w * rut;
    float level = WATER_LEVEL.x + WATER_LEVEL.y * wetness + WATER_LEVEL.z * soaks;
    float pool = smoothstep(level + WATER_SHORE.x, level + WATER_SHORE.y, hollow);
    pool *= smoothstep(WATER_STANDS.x, WATER_STANDS.y, face.z);
    return Water(film, pool * film, WATER_RIPPLES * seen(WATER_FINE.x, grain) * fine.yz);
}
