// Screen-space reflections of wet surfaces: reflected rays are traced in the G-buffer of the statics. Movables have no
// reflection, so they never change a pixel this way.
uniform sampler2D mirror_albedo;    // G-buffer of the statics
uniform usampler2D mirror_material;
uniform mat3 screen_basis;          // inverse of ray_basis
uniform vec3 mirrored_light;        // radiance of an average wall over its albedo

const int MIRROR_STEPS = 24;
const int MIRROR_HALVINGS = 4;
const float MIRROR_REACH = 150.0;   // metres
// Assumed thickness of surfaces: metres, plus a share of the distance. A ray may pass farther behind a surface than that.
const vec2 MIRROR_THICKNESS = vec2(1.0, 0.1);
// Height above the mirror from which on a surface is visible in it, metres.
const float ABOVE = 0.03;

ivec2 mirror_sample(vec2 screen) {
    return clamp(ivec2((screen * 0.5 + 0.5) * vec2(sample_size)), ivec2(0), sample_size - 1);
}

// True if a ray at a place of the image and a depth is behind the visible surface, whose depth is ``seen``. A surface no higher
// than the mirror does not count: otherwise the road would hide itself where a sample covers metres of it.
bool is_behind(vec2 screen, float depth, float level, out float seen) {
    ivec2 place = mirror_sample(screen);
    seen = linear_depth(texelFetch(mirror_depth, place, 0).r);
    return seen < 0.999 * depth && eye.z + ray_of(place).z * seen > level + ABOVE;
}

// Radiance at p from directions within ``spread`` radians of r, and the known share of it, which is 0 where the image shows only
// surfaces below the mirror.
vec4 mirrored(vec3 p, vec3 r, float spread, vec3 above, bool wanted) {
    vec3 first = screen_basis * (p - eye), toward = screen_basis * r;
    float reach = toward.z < 0.0 ? min(MIRROR_REACH, 0.9 * first.z / -toward.z) : MIRROR_REACH;
    vec3 last = first + reach * toward;
    vec2 from = first.xy / first.z, way = last.xy / last.z - from;
    // Inverse depth is linear along the ray's path over the image, 0 … 1. Only a part of the path may lie in the image.
    float near = 1.0 / first.z, rise = 1.0 / last.z - near;
    vec2 exits = (1.0 - from * sign(way)) / (abs(way) + 1e-6);
    float part = clamp(min(exits.x, exits.y), 0.0, 1.0);
    bool hit = false;
    float before = 0.0, behind = part, passed = 0.0;
    int i = 1, steps = wanted ? MIRROR_STEPS : 1;
    do {
        // Short steps first, so that the reflection of a thing on the road begins at its foot.
        float share = float(i) / float(MIRROR_STEPS), at = part * share * mix(0.25, 1.0, share);
        float depth = 1.0 / (near + rise * at), nearer = 1.0 / (near + rise * passed);
        float seen;
        bool met = is_behind(from + way * at, depth, p.z, seen) && !hit && wanted
            && seen > nearer - MIRROR_THICKNESS.x - MIRROR_THICKNESS.y * nearer;
        before = met ? passed : before;
        behind = met ? at : behind;
        hit = hit || met;
        passed = at;
    } while (++i <= steps);
    i = 0;
    int halvings = hit ? MIRROR_HALVINGS : 1;
    do {
        float at = 0.5 * (before + behind), seen;
        bool met = is_behind(from + way * at, 1.0 / (near + rise * at), p.z, seen) && hit;
        behind = met ? at : behind;
        before = met ? before : at;
    } while (++i < halvings);
    // A rough film blurs the reflection vertically, in the plane of the ray. Beyond the image, its border is repeated.
    vec2 middle = from + way * behind;
    float along = reach * behind / (last.z * (near + rise * behind));
    vec3 clear_air = exp(-extinction * along);
    vec2 tap = normalize(way + vec2(0.0, 1e-6)) * (spread * 0.5 / length(ray_basis[1]));
    float sharp = 1.0 - smoothstep(0.02, 0.08, spread);
    vec4 sum = vec4(0.0);
    i = -2;
    int taps = wanted ? 2 : -2;
    do {
        ivec2 place = mirror_sample(middle + float(i) * tap);
        float window = texelFetch(mirror_depth, place, 0).r;
        bool is_sky = window == 1.0, is_thing = eye.z + ray_of(place).z * linear_depth(window) > p.z + ABOVE;
        vec3 root = texelFetch(mirror_albedo, place, 0).rgb;
        uvec2 material = texelFetch(mirror_material, place, 0).rg;
        vec4 glow = texelFetch(material_table, ivec2(2, int(material.x)), 0);
        // A rough film spreads a lamp's light too far to see.
        vec3 emissive = sharp * emitted(glow, unpacked_factors(material.y).y * root * root);
        vec3 color = is_sky ? above : mix(haze, root * root * mirrored_light + emissive, clear_air);
        vec4 share = vec4(color, 1.0) * (is_sky || is_thing ? float(3 - abs(i)) / 9.0 : 0.0);
        sum += wanted ? share : vec4(0.0);
    } while (++i <= taps);
    return vec4(sum.rgb / max(sum.a, 1e-6), min(3.0 * sum.a, 1.0));
}
