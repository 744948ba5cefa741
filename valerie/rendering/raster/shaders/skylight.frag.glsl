// Light of the sky and of what hides it, as spherical harmonics of order 1; one value for SKYLIGHT_CELL × SKYLIGHT_CELL
// samples, taken at the first of them.
// The sky is seen or hidden in DIRECTIONS directions, each with a shadow map of the statics (one tile of an atlas).
// Where it is hidden, the light of an average street surface comes from there: lit by the sun if it faces it.
#include "octahedron.glsl"
#include "sample.glsl"
uniform sampler2D normals_map;
uniform sampler2D atlas;                       // TILES.x × TILES.y shadow maps
uniform ivec2 tiles;
uniform vec4 tile_rows[3 * DIRECTIONS];        // world to [0, 1]³ of each tile
uniform vec3 directions[DIRECTIONS];           // towards the sky, uniform over the hemisphere
uniform vec3 sky_radiance[DIRECTIONS];
uniform vec3 toward_sun;
uniform vec3 surface_by_sky;                   // radiance of a surface that sees half the sky
uniform vec3 surface_by_sun;                   // more, if it faces the sun
uniform vec3 ground;
layout(location = 0) out vec4 out_red;         // mean, x, y, z
layout(location = 1) out vec4 out_green;
layout(location = 2) out vec4 out_blue;
layout(location = 3) out vec4 out_open;        // the same of the sky's visibility

void main() {
    ivec2 s = ivec2(gl_FragCoord.xy) * SKYLIGHT_CELL;
    float window = texelFetch(depth_map, s, 0).r;
    out_red = vec4(0.0);
    out_green = vec4(0.0);
    out_blue = vec4(0.0);
    out_open = vec4(0.0);
    if (window == 1.0) return;
    vec3 normal = octahedron_decode(texelFetch(normals_map, s, 0).zw);
    vec3 p = eye + ray_of(s) * linear_depth(window) + normal * 0.12;
    vec2 tile_pixels = vec2(textureSize(atlas, 0) / tiles);
    vec2 atlas_scale = 1.0 / vec2(textureSize(atlas, 0));
    for (int k = 0; k < DIRECTIONS; ++k) {
        vec4 h = vec4(p, 1.0);
        vec3 c = vec3(dot(tile_rows[3 * k], h), dot(tile_rows[3 * k + 1], h), dot(tile_rows[3 * k + 2], h));
        bool inside = all(greaterThan(c, vec3(0.0))) && all(lessThan(c, vec3(1.0)));
        vec2 t = clamp(c.xy * tile_pixels, vec2(1.0), tile_pixels - 1.0) + vec2(k % tiles.x, k / tiles.x) * tile_pixels;
        vec4 lit = vec4(greaterThanEqual(textureGather(atlas, t * atlas_scale), vec4(c.z)));
        vec2 f = fract(t - 0.5);
        float open = inside ? mix(mix(lit.w, lit.z, f.x), mix(lit.x, lit.y, f.x), f.y) : 1.0;
        vec3 d = directions[k];
        float faces_sun = max(dot(normalize(vec3(-d.xy, 0.2)), toward_sun), 0.0);
        vec3 light = mix(surface_by_sky + surface_by_sun * faces_sun, sky_radiance[k], open);
        vec4 basis = vec4(1.0, 3.0 * d);
        out_red += light.r * basis;
        out_green += light.g * basis;
        out_blue += light.b * basis;
        out_open += open * basis;
    }
    // The upper half of the sphere is the mean over the directions; the lower half is the ground, seen from all around.
    const float half_of = 0.5 / float(DIRECTIONS);
    vec4 below = vec4(0.5, 0.0, 0.0, -0.75);
    out_red = out_red * half_of + ground.r * below;
    out_green = out_green * half_of + ground.g * below;
    out_blue = out_blue * half_of + ground.b * below;
    out_open *= half_of;
}
