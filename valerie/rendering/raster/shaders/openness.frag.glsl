// Visibility of the sky in DIRECTIONS directions, computed at the first of SKYLIGHT_CELL × SKYLIGHT_CELL samples for all of them.
// Each direction has a shadow map of the statics, a tile of an atlas. Visibility does not depend on the light.
#include "octahedron.glsl"
#include "sample.glsl"
uniform sampler2D normals_map;
uniform sampler2D atlas;                       // tiles.x × tiles.y shadow maps
uniform ivec2 tiles;
uniform vec4 tile_rows[3 * DIRECTIONS];        // world to [0, 1]³ of each tile
uniform vec3 tile_extents[DIRECTIONS];         // metres
#ifdef MOVABLES
#include "columns.glsl"
uniform sampler2D mirror_depth;                // of the statics
#endif
layout(location = 0) out uvec4 out_first;      // four directions per number, the first in the lowest byte, in steps of 1/255
layout(location = 1) out uvec4 out_second;

// Steepest slope, in metres along the light per metre across it, at which a surface's own texels are told from its casters.
const float STEEPEST = 30.0;

#ifdef MOVABLES
const int COVER_STEPS = 9;
const float COVER_FIRST = 0.1, COVER_GROWTH = 1.35;  // the first step and each further one, metres
const float COVER_GAP = 0.1;                         // between a surface and what covers it, metres

// True if the top of a movable, such as an umbrella, hides the sky in direction d from a place below it. The sides of movables hide
// nothing, since a column does not tell a canopy from a wall.
bool is_covered(vec3 p, vec3 d) {
    float along = COVER_FIRST, height = p.z + COVER_GAP, top = column(p.xy).y;
    int i = 0;
    while (top > height && i++ < COVER_STEPS) {
        vec3 x = p + along * d;
        if (x.z >= top) return column(p.xy + d.xy * ((top - p.z) / d.z)).y > height;
        top = column(x.xy).y;
        height = x.z;
        along *= COVER_GROWTH;
    }
    return false;
}
#endif

void main() {
    ivec2 s = ivec2(gl_FragCoord.xy) * SKYLIGHT_CELL;
    float window = texelFetch(depth_map, s, 0).r;
    out_first = out_second = uvec4(0u);
    int numbers = window == 1.0 ? 0 : DIRECTIONS / 4;
    vec3 normal = octahedron_decode(texelFetch(normals_map, s, 0).zw);
    vec3 place = eye + ray_of(s) * linear_depth(window);
    vec4 h = vec4(place + normal * 0.12, 1.0);
#ifdef MOVABLES
    // Only movables are covered: this bounds the layer's rectangle.
    bool moves = texelFetch(mirror_depth, s, 0).r - window >= ROUNDED_DEPTH;
#endif
    vec2 tile_pixels = vec2(textureSize(atlas, 0) / tiles);
    vec2 atlas_scale = 1.0 / vec2(textureSize(atlas, 0));
    for (int i = 0; i < numbers; ++i) {
        uint four = 0u;
        for (int k = 4 * i; k < 4 * i + 4; ++k) {
            vec3 c = vec3(dot(tile_rows[3 * k], h), dot(tile_rows[3 * k + 1], h), dot(tile_rows[3 * k + 2], h));
            bool inside = all(greaterThan(c, vec3(0.0))) && all(lessThan(c, vec3(1.0)));
            vec2 corner = vec2(k % tiles.x, k / tiles.x) * tile_pixels;
            vec2 t = clamp(c.xy * tile_pixels, vec2(1.0), tile_pixels - 1.0) + corner;
            vec2 f = fract(t - 0.5);
            // Each texel is compared with the surface's plane at the texel, so that a sloping surface does not hide itself.
            vec3 n = tile_extents[k] * vec3(dot(tile_rows[3 * k].xyz, normal), dot(tile_rows[3 * k + 1].xyz, normal),
                dot(tile_rows[3 * k + 2].xyz, normal));
            vec2 slope = clamp(-n.xy / (abs(n.z) < 1e-3 ? 1e-3 : n.z), -STEEPEST, STEEPEST);
            slope *= tile_extents[k].xy / (tile_extents[k].z * tile_pixels);
            vec4 plane = c.z + slope.x * (vec4(0.0, 1.0, 1.0, 0.0) - f.x) + slope.y * (vec4(1.0, 1.0, 0.0, 0.0) - f.y);
            vec4 lit = vec4(greaterThanEqual(textureGather(atlas, t * atlas_scale), plane));
            float open = inside ? mix(mix(lit.w, lit.z, f.x), mix(lit.x, lit.y, f.x), f.y) : 1.0;
#ifdef MOVABLES
            vec3 toward = -tile_extents[k].z * tile_rows[3 * k + 2].xyz;
            open = moves && dot(toward, normal) > 0.0 && is_covered(place + normal * 0.02, toward) ? 0.0 : open;
#endif
            four = (four >> 8) | (uint(open * 255.0 + 0.5) << 24);
        }
        // Each number enters at the end and shifts the others; after the last, all are in their places.
        out_first = uvec4(out_first.yzw, out_second.x);
        out_second = uvec4(out_second.yzw, four);
    }
}
