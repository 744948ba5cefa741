// Screen-space reflections of wet surfaces: reflected rays are traced in the G-buffer of the statics, and on level ground in that
// of the movables.
uniform sampler2D mirror_albedo;    // G-buffer of the statics
uniform usampler2D mirror_material;
uniform mat3 screen_basis;          // inverse of ray_basis
uniform vec3 mirrored_light;        // radiance of an average wall over its albedo

const int MIRROR_STEPS = 24;
const int MIRROR_HALVINGS = 4;
const int MIRROR_TAPS = 4;          // of the blur, to each side
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

// Way of a mirrored ray over the image, 0 … 1.
struct Path {
    vec2 from, way;
    float near, rise;   // inverse depth, which is linear along the way
    float part;         // of the way lies in the image
    float reach, end;   // the ray's length and the depth of its end, metres
};

Path path_of(vec3 p, vec3 r) {
    vec3 first = screen_basis * (p - eye), toward = screen_basis * r;
    float reach = toward.z < 0.0 ? min(MIRROR_REACH, 0.9 * first.z / -toward.z) : MIRROR_REACH;
    vec3 last = first + reach * toward;
    vec2 from = first.xy / first.z, way = last.xy / last.z - from;
    vec2 exits = (1.0 - from * sign(way)) / (abs(way) + 1e-6);
    float near = 1.0 / first.z;
    return Path(from, way, near, 1.0 / last.z - near, clamp(min(exits.x, exits.y), 0.0, 1.0), reach, last.z);
}

float depth_on(Path path, float at) {
    return 1.0 / (path.near + path.rise * at);
}

// Place of a step. Steps are short at first, so that the reflection of a thing on the road begins at its foot.
float place_of(Path path, int step) {
    float share = float(step) / float(MIRROR_STEPS);
    return path.part * share * mix(0.25, 1.0, share);
}

// Distance from the mirror, metres.
float along(Path path, float at) {
    return path.reach * at * depth_on(path, at) / path.end;
}

// Step over the image between the taps of a blurred reflection: what stands close to the mirror is sharp. A rough film blurs
// vertically, in the plane of the ray.
vec2 blur_step(Path path, float at, float spread) {
    float far = along(path, at), narrow = far / (far + 1.0 / path.near);
    return normalize(path.way + vec2(0.0, 1e-6)) * (spread * narrow / (float(MIRROR_TAPS) * length(ray_basis[1])));
}

float blur_share(int tap) {
    const float TAPS = float(MIRROR_TAPS + 1);
    return (TAPS - abs(float(tap))) / (TAPS * TAPS);
}

// Light of a surface with this texel of a G-buffer, as far as it reaches a mirror. A rough film spreads a lamp's light too far to
// see.
vec3 shown(vec3 root, uvec2 material, float far, float spread) {
    vec4 glow = texelFetch(material_table, ivec2(2, int(material.x)), 0);
    vec3 emissive = (1.0 - smoothstep(0.02, 0.08, spread)) * emitted(glow, unpacked_factors(material.y).y * root * root);
    return mix(haze, root * root * mirrored_light + emissive, exp(-extinction * far));
}

// Radiance at p from directions within ``spread`` radians of r, and the known share of it, which is 0 where the image shows only
// surfaces below the mirror. A ray that ends behind a surface, however far, meets it, since nobody sees how thick a tree is. Beyond
// the image, its border is repeated.
vec4 mirrored(vec3 p, vec3 r, float spread, vec3 above, bool wanted) {
    Path path = path_of(p, r);
    bool hit = false, hidden = false;
    float before = 0.0, behind = path.part, passed = 0.0;
    int i = 1, steps = wanted ? MIRROR_STEPS : 1;
    do {
        float at = place_of(path, i), nearer = depth_on(path, passed), seen;
        bool hides = is_behind(path.from + path.way * at, depth_on(path, at), p.z, seen) && wanted;
        bool enters = hides && !hidden && !hit;
        before = enters ? passed : before;
        behind = enters ? at : hides || hit ? behind : path.part;
        hit = hit || enters && seen > nearer - MIRROR_THICKNESS.x - MIRROR_THICKNESS.y * nearer;
        hidden = hides;
        passed = at;
    } while (++i <= steps);
    hit = hit || hidden;
    i = 0;
    int halvings = hit ? MIRROR_HALVINGS : 1;
    do {
        float at = 0.5 * (before + behind), seen;
        bool met = is_behind(path.from + path.way * at, depth_on(path, at), p.z, seen) && hit;
        behind = met ? at : behind;
        before = met ? before : at;
    } while (++i < halvings);
    vec2 middle = path.from + path.way * behind, tap = blur_step(path, behind, spread);
    vec4 sum = vec4(0.0);
    i = -MIRROR_TAPS;
    int taps = wanted ? MIRROR_TAPS : -MIRROR_TAPS;
    do {
        ivec2 place = mirror_sample(middle + float(i) * tap);
        float window = texelFetch(mirror_depth, place, 0).r;
        bool is_sky = window == 1.0, is_thing = eye.z + ray_of(place).z * linear_depth(window) > p.z + ABOVE;
        vec3 root = texelFetch(mirror_albedo, place, 0).rgb;
        vec3 color = shown(root, texelFetch(mirror_material, place, 0).rg, along(path, behind), spread);
        vec4 share = vec4(is_sky ? above : color, 1.0) * (is_sky || is_thing ? blur_share(i) : 0.0);
        sum += wanted ? share : vec4(0.0);
    } while (++i <= taps);
    return vec4(sum.rgb / max(sum.a, 1e-6), min(3.0 * sum.a, 1.0));
}

#ifdef MOVABLES
uniform sampler2D moving_albedo;    // G-buffer with the movables
uniform usampler2D moving_material;
// Distance behind a visible movable, metres of depth, at which a ray still meets it (`Reach.mirrored` is wider).
const float MOVABLE_THICKNESS = 0.5;
const int MOVABLE_HALVINGS = 7;
const float NO_MOVABLE = 1e9;

// The sample of a pixel that every pane covers, see ``see_through`` in surface.glsl.
ivec2 movable_sample(vec2 screen) {
    ivec2 place = mirror_sample(screen) & ~1;
    return place + ivec2(1 ^ (place.x / 4 & 1), 0);
}

// Depth of the movable at a place of the image.
float movable_depth(ivec2 place) {
    float window = texelFetch(depth_map, place, 0).r;
    return texelFetch(mirror_depth, place, 0).r - window < ROUNDED_DEPTH ? NO_MOVABLE : linear_depth(window);
}

// Radiance of the movables in a level mirror at p, seen from direction d, and their share of what is seen there. Only what is met
// exactly above the mirror counts, which bounds the layer's rectangle.
vec4 mirrored_movables(vec3 p, vec3 d, float spread, bool wanted) {
    Path path = path_of(p, vec3(d.xy, abs(d.z)));
    bool hit = false;
    float before = 0.0, behind = path.part, passed = 0.0;
    int i = 1, steps = wanted ? MIRROR_STEPS : 1;
    do {
        float at = place_of(path, i), seen = movable_depth(movable_sample(path.from + path.way * at));
        bool met = seen < depth_on(path, at) && seen > depth_on(path, passed) - MOVABLE_THICKNESS && !hit && wanted;
        before = met ? passed : before;
        behind = met ? at : behind;
        hit = hit || met;
        passed = at;
    } while (++i <= steps);
    i = 0;
    int halvings = hit ? MOVABLE_HALVINGS : 1;
    do {
        float at = 0.5 * (before + behind);
        bool met = movable_depth(movable_sample(path.from + path.way * at)) < depth_on(path, at);
        behind = met ? at : behind;
        before = met ? before : at;
    } while (++i < halvings);
    vec2 middle = path.from + path.way * behind, tap = blur_step(path, behind, spread);
    hit = hit && depth_on(path, behind) - movable_depth(movable_sample(middle)) < MOVABLE_THICKNESS;
    vec4 sum = vec4(0.0);
    i = -MIRROR_TAPS;
    int taps = hit ? MIRROR_TAPS : -MIRROR_TAPS;
    do {
        ivec2 place = movable_sample(middle + float(i) * tap);
        vec3 root = texelFetch(moving_albedo, place, 0).rgb;
        vec3 color = shown(root, texelFetch(moving_material, place, 0).rg, along(path, behind), spread);
        sum += vec4(color, 1.0) * (hit && movable_depth(place) < NO_MOVABLE ? blur_share(i) : 0.0);
    } while (++i <= taps);
    return vec4(sum.rgb / max(sum.a, 1e-6), sum.a);
}
#endif
