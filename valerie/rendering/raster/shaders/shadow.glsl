// Soft shadows of the sun: percentage closer soft shadows (Fernando 2005, doi:10.1145/1187112.1187153) with the sun's angular
// size. A receiver plane prevents self-shadowing of surfaces by wide kernels. All lengths are in metres.
uniform mat3 light_rows;        // world to the light's frame; depth grows away from the sun
uniform float sun_spread;       // tangent of half the sun's angle
uniform float largest_penumbra;
const int BLOCKER_TAPS = 6;
const int FILTER_TAPS = 10;

// Depth of the caster at a place of the map; very large without a caster.
float caster_depth(sampler2D map, vec2 at, vec2 scale, ivec2 last, float range) {
    float depth = texelFetch(map, clamp(ivec2(at * scale), ivec2(0), last), 0).r;
    return depth == 1.0 ? 1e9 : depth * range;
}

// Visible share of the sun's disc, exactly 1 where the map has no caster within the largest penumbra. ``way`` is any direction in
// the map's plane. A CPU rasteriser runs both sides of a branch, and a loop as long as any of its lanes needs: the whole body once
// more if the loop tests its condition first. All loops over taps therefore test it last, and turn once without effect where the
// result is not wanted.
float lit_share(sampler2D map, vec3 origin, vec3 extent, vec3 receiver, vec2 slope, vec2 way, bool wanted) {
    vec3 at = receiver - origin;
    bool inside = wanted && all(greaterThan(at, vec3(0.0))) && all(lessThan(at, extent));
    vec2 texels = vec2(textureSize(map, 0));
    vec2 texel = extent.xy / texels;
    float smallest = max(texel.x, texel.y) * 0.75;
    float bias = 0.25 * (abs(slope.x) * texel.x + abs(slope.y) * texel.y) + 0.004;
    vec2 scale = texels / extent.xy;
    ivec2 last = textureSize(map, 0) - 1;
    float search = min(largest_penumbra, max(smallest, at.z * sun_spread));
    vec2 toward = way;
    float blockers = 0.0, distance_sum = 0.0;
    int i = 0, taps = inside ? BLOCKER_TAPS : 1;
    do {
        // The first tap is the place itself, since a caster may be narrower than the gaps between the others (a head over its
        // face).
        vec2 o = toward * (search * sqrt(float(i) / float(BLOCKER_TAPS)));
        toward = GOLDEN * toward;
        float plane = at.z + dot(slope, o) - bias;
        float depth = caster_depth(map, at.xy + o, scale, last, extent.z);
        if (inside && depth < plane) {
            blockers += 1.0;
            distance_sum += at.z - depth;
        }
    } while (++i < taps);
    float width = clamp(distance_sum / max(blockers, 1.0) * sun_spread, smallest, search);
    float hidden = 0.0;
    i = 0;
    taps = blockers > 0.0 ? FILTER_TAPS : 1;
    toward = RADIAN * way;
    do {
        vec2 o = toward * (width * sqrt((float(i) + 0.5) / float(FILTER_TAPS)));
        toward = GOLDEN * toward;
        float plane = at.z + dot(slope, o) - bias;
        float depth = caster_depth(map, at.xy + o, scale, last, extent.z);
        hidden += blockers > 0.0 && depth < plane ? 1.0 : 0.0;
    } while (++i < taps);
    return 1.0 - hidden / float(FILTER_TAPS);
}

#ifdef PLAIN
const int LIT_SAMPLES = 4;
#else
const int LIT_SAMPLES = 1;
#endif

// The mean of lit_share over a pixel's samples, or its value at one. The columns of ``steps`` lead from sample to sample in the
// map's plane.
float lit_mean(sampler2D map, vec3 origin, vec3 extent, vec3 receiver, vec2 slope, vec2 way, mat2 steps, bool wanted) {
    vec3 at = receiver - origin;
    bool inside = wanted && all(greaterThan(at, vec3(0.0))) && all(lessThan(at, extent));
    float sum = 0.0;
    // LLVM's time for many loops in sequence grows exponentially; a loop around others interrupts the sequence. The compiler must
    // not know that it has one turn.
    int i = 0, samples = inside ? LIT_SAMPLES : 0;
    do {
        vec2 o = steps * (vec2(i & 1, i >> 1) - 0.5);
        sum += lit_share(map, origin, extent, receiver + vec3(o, dot(slope, o)), slope, way, inside);
        way = RADIAN * way;
    } while (++i < samples);
    return sum / float(max(samples, 1));
}
