// Radiance of every sample: sun with soft shadows, sky light with ambient occlusion, reflections of the sky, haze.
// Unit: EXPOSURE × π × radiance (sky.py).
#include "disc.glsl"
#include "octahedron.glsl"
#include "roughness.glsl"
#include "sample.glsl"
#include "shadow.glsl"
#include "captured.glsl"
#include "panes.glsl"
// G-buffer of the samples, or of plain pixels (plain.frag).
uniform sampler2D albedo_map;
uniform sampler2D normals_map;
uniform usampler2D material_map;
#ifdef PLAIN
uniform sampler2D plain_depth;
#endif
uniform sampler2D material_table;
uniform sampler2D sky_table;        // columns: azimuth from the sun 0 … π, rows: square root of elevation
uniform sampler2D skylight_red;
uniform sampler2D skylight_green;
uniform sampler2D skylight_blue;
uniform sampler2D skylight_zonal;
uniform usampler2D openness_first;  // see openness.frag
uniform usampler2D openness_second;
uniform usampler2D nearest_directions;  // the nearest of the sky's directions, and their weights: shadows.py
uniform sampler2D direction_shares;
uniform sampler2D hiding;           // radiance of the surfaces that hide the sky in each direction
uniform sampler2D occlusion_map;
uniform sampler2D static_shadow;
uniform vec3 static_origin;
uniform vec3 static_extent;
uniform sampler2D static_casters;   // least and largest depth around each block of the static shadow map
#ifdef MOVABLES
uniform sampler2D movable_shadow;
uniform vec3 movable_origin;
uniform vec3 movable_extent;
#endif
uniform vec3 toward_sun;
uniform vec3 sun;
uniform vec3 haze;
uniform vec3 ground;
uniform vec3 below;                 // radiance of the scene's ground
uniform vec3 extinction;            // per metre
uniform float sun_angle;            // angular radius of the disc, radians
uniform float shadow_distance;      // metres along the optical axis; shadows fade out before it
#ifndef RECEIVED
layout(location = 0) out vec4 out_radiance;
#endif
#ifdef LAMPS
#include "lamps.glsl"
#endif

// Brightest stored values: of surfaces, whose highlights would flicker, and of the sun's disc, beyond which float16 ends.
const float BRIGHTEST = 24.0;
const float BRIGHTEST_SKY = 65504.0;
#ifdef SNOW
const vec3 SNOW_DEPTHS = vec3(0.93, 0.99, 1.12);    // hue of light from all sides in snow, relative luminance 1
#endif

// Emissive light of a material with the texel ``glow`` (materials.py); ``room`` is the share that its room shows.
vec3 emitted(vec4 glow, vec3 room) {
    return glow.rgb * (glow.a < 0.0 ? room : vec3(1.0));
}

vec3 sky(vec3 d) {
    float elevation = asin(clamp(d.z, 0.0, 1.0));
    vec2 flat_d = normalize(d.xy + vec2(1e-6, 0.0)), flat_s = normalize(toward_sun.xy + vec2(1e-6, 0.0));
    float azimuth = acos(clamp(dot(flat_d, flat_s), -1.0, 1.0));
    vec2 size = vec2(textureSize(sky_table, 0));
    // The table's entries are at texel centres, so the outer half texel is constant.
    vec2 at = clamp(vec2(azimuth / 3.14159265, sqrt(elevation / 1.57079633)) * size, vec2(0.5), size - 0.5);
    vec3 above = textureLod(sky_table, at / size, 0.0).rgb;
    return mix(ground, above, smoothstep(-0.06, 0.0, d.z));
}

vec3 sun_disc(vec3 d) {
    float angle = acos(clamp(dot(d, toward_sun), -1.0, 1.0));
    float disc = 1.0 - smoothstep(sun_angle * 0.95, sun_angle * 1.05, angle);
    // Scattering in the lens adds a glow that falls off within some degrees.
    // ``sun`` is the radiance of a white surface that faces the sun: the disc's radiance times the disc's solid angle over pi.
    return sun * (disc / (sun_angle * sun_angle) + 0.35 * exp(-angle / 0.03) + 0.05 * exp(-angle / 0.12));
}

// Irradiance of a surface with normal n, or approximately the mean radiance around direction n: the light's spherical harmonics
// times those of the clamped cosine, 1, 2/3 and 1/4 (Ramamoorthi and Hanrahan 2001, doi:10.1145/383259.383317).
vec3 skylight(vec4 red, vec4 green, vec4 blue, vec3 zonal, vec3 n) {
    vec4 n1 = vec4(1.0, n * 0.6666667);
    return max(vec3(dot(red, n1), dot(green, n1), dot(blue, n1)) + zonal * (0.375 * n.z * n.z - 0.125), vec3(0.0));
}

// Share of the sky in one of its directions that nothing hides.
float open_toward(uint k, uvec4 first, uvec4 second) {
    uvec4 half_of = k < 16u ? first : second;
    uvec2 quarter = (k & 8u) == 0u ? half_of.xy : half_of.zw;
    uint four = (k & 4u) == 0u ? quarter.x : quarter.y;
    return float((four >> (8u * (k & 3u))) & 255u) / 255.0;
}

// Radiance from direction r: that of the sky, ``above``, of surfaces that hide it, or of the ground. Undefined if not wanted.
vec3 surroundings(vec3 r, ivec2 cell, vec3 above, bool wanted) {
    vec2 p = r.xy / (abs(r.x) + abs(r.y) + max(r.z, 0.0));
    int side = textureSize(direction_shares, 0).x;
    ivec2 at = min(ivec2((vec2(p.x + p.y, p.x - p.y) * 0.5 + 0.5) * float(side)), ivec2(side - 1));
    uvec4 nearest = texelFetch(nearest_directions, at, 0);
    vec4 shares = wanted ? texelFetch(direction_shares, at, 0) : vec4(0.0);
    uvec4 first = texelFetch(openness_first, cell, 0), second = texelFetch(openness_second, cell, 0);
    vec4 sum = vec4(0.0);
    int i = 0, taps = wanted ? 4 : 1;
    do {
        float open = open_toward(nearest[i], first, second);
        vec3 hides = texelFetch(hiding, ivec2(int(nearest[i]), 0), 0).rgb;
        sum += shares[i] * vec4(mix(hides, above, open), 1.0);
    } while (++i < taps);
    return mix(below, sum.rgb / max(sum.a, 1e-6), smoothstep(-0.05, 0.05, r.z));
}

// The texel of a coarser map whose value applies to sample s: that of its own cell, or of the neighbour nearest in depth. The map
// has one value per ``cell`` × ``cell`` samples, computed at the cell's first sample.
ivec2 nearest_cell(ivec2 s, float depth, int cell) {
    ivec2 own = s / cell;
    ivec2 step_to = ivec2(s.x % cell * 2 < cell ? -1 : 1, s.y % cell * 2 < cell ? -1 : 1);
    ivec2 last = (sample_size - 1) / cell;
    ivec2 best = own;
    float best_gap = abs(linear_depth(texelFetch(depth_map, own * cell, 0).r) - depth) - 0.01 * depth;
    // No neighbour can improve a gap of zero.
    int i = 1, cells = best_gap > 0.0 ? 4 : 1;
    do {
        ivec2 other = clamp(own + step_to * ivec2(i & 1, i >> 1), ivec2(0), last);
        float gap = abs(linear_depth(texelFetch(depth_map, other * cell, 0).r) - depth);
        if (gap < best_gap) {
            best = other;
            best_gap = gap;
        }
    } while (++i < cells);
    return best;
}

// Share of even light that GGX microfacets reflect (split sum, Karis 2013, "Real shading in Unreal Engine 4"), fitted to the
// integral with Smith's height-correlated shadowing: within 17 % for a reflectance of 4 %. What has none at normal incidence has
// none at grazing angles either.
vec3 environment_reflectance(vec3 f0, float roughness, float facing) {
    float r = roughness, all = 1.0 - r * r * (0.707 - 0.523 * r + facing * (1.02 * r - 0.39));
    float grazing = (0.985 + r * (1.104 * r - 2.045)) * pow(1.0 - min(facing, 1.0), 4.66 + r * (3.16 * r - 3.91));
    return mix(min(50.0 * f0, 1.0) * grazing, vec3(all), f0);
}

float sunlit(vec3 p, vec3 normal, float depth, bool wanted) {
    vec2 way = direction(gradient_noise(gl_FragCoord.xy) * 6.2831853);
    vec3 n = light_rows * normal;
    float side = n.z < 0.0 ? 1.0 : -1.0;
    // dz/dx and dz/dy of the surface in the light's frame. They are clamped, since a surface along the light has no useful slope.
    vec2 slope = clamp(-n.xy / (abs(n.z) < 0.05 ? -side * 0.05 : n.z), vec2(-6.0), vec2(6.0));
    // Far from the eye, the steps of 2⁻²⁴ of the window's depth are wide.
    float step_here = depth * depth / near_far.x * exp2(-24.0);
    vec3 receiver = light_rows * (p + normal * (side * (0.012 + 4.0 * step_here)));
    // No taps are needed if all casters around lie behind the planes of the taps, or all in front of them.
    vec3 at = (receiver - static_origin) / static_extent;
    bool inside = all(greaterThan(at, vec3(0.0))) && all(lessThan(at, vec3(1.0)));
    ivec2 blocks = textureSize(static_casters, 0);
    vec2 casters = texelFetch(static_casters, clamp(ivec2(at.xy * vec2(blocks)), ivec2(0), blocks - 1), 0).rg;
    vec2 gap = (casters - at.z) * static_extent.z;
    vec2 texel = static_extent.xy / vec2(textureSize(static_shadow, 0));
    float tilt = length(slope) * (largest_penumbra + max(texel.x, texel.y)) + 0.01;
    bool hidden = wanted && inside && gap.y < -tilt;
    bool unsure = wanted && inside && gap.x < tilt && !hidden;
#ifdef PLAIN
    // Steps along the surface from sample to sample. They are clamped, since a surface seen edge-on has no useful steps.
    vec3 ray = (p - eye) / depth;
    float along = dot(normal, ray);
    vec3 slanted = ray / (abs(along) < 0.02 ? -0.02 : along);
    vec3 right = ray_basis[0] * (2.0 / float(sample_size.x)), up = ray_basis[1] * (2.0 / float(sample_size.y));
    mat2 steps = depth * mat2(
        (light_rows * (right - slanted * dot(normal, right))).xy, (light_rows * (up - slanted * dot(normal, up))).xy);
#else
    const mat2 steps = mat2(0.0);
#endif
    float lit = lit_mean(static_shadow, static_origin, static_extent, receiver, slope, way, steps, unsure);
    lit = hidden ? 0.0 : lit;
    lit = mix(lit, 1.0, smoothstep(0.85, 1.0, depth / shadow_distance));
#ifdef MOVABLES
    float moving = lit_mean(
        movable_shadow, movable_origin, movable_extent, receiver, slope, way, steps, wanted && lit > 0.0);
    lit = min(lit, moving);
#endif
    return lit;
}

#if defined(RAIN) || defined(SNOW) || defined(LEAVES)
uniform sampler2D mirror_depth;     // of the statics
#endif

#if defined(RAIN) || defined(SNOW) || defined(LEAVES) || defined(FLAKES)
float random_of(vec3 p) {
    p = fract(p * vec3(0.1031, 0.1030, 0.0973));
    p += dot(p, p.yzx + 33.33);
    return fract((p.x + p.y) * p.z);
}
#endif

#if defined(RAIN) || defined(SNOW) || defined(LEAVES)
#include "relief.glsl"
#endif
#if defined(SNOW) || defined(LEAVES)
#include "lying.glsl"
#endif
#ifdef FLAKES
#include "flakes.glsl"
#endif
#ifdef RAIN
#include "mirror.glsl"
#include "water.glsl"
#include "streaks.glsl"
#endif

#ifdef RECEIVED
// Instead of the image, the light that arrives on surfaces before any material, one sample per pixel (person_light.py).
layout(location = 0) out vec4 out_received;  // luminance of sunlight and of all other light; share of the sun's disc; depth

void main() {
    ivec2 s = ivec2(gl_FragCoord.xy) * 2;  // one of the pixel's two by two samples
    float window = texelFetch(depth_map, s, 0).r;
    out_received = vec4(0.0);
    if (window == 1.0) return;
    float depth = linear_depth(window);
    vec3 face = octahedron_decode(texelFetch(normals_map, s, 0).zw);
    float cosine = dot(face, toward_sun);
    float lit = sunlit(eye + ray_of(s) * depth, face, depth, cosine > 0.0);
    ivec2 cell = nearest_cell(s, depth, SKYLIGHT_CELL);
    vec3 ambient = skylight(
        texelFetch(skylight_red, cell, 0), texelFetch(skylight_green, cell, 0), texelFetch(skylight_blue, cell, 0),
        texelFetch(skylight_zonal, cell, 0).rgb, face);
    float ambient_open = texelFetch(occlusion_map, nearest_cell(s, depth, 2), 0).r;
    const vec3 luminance = vec3(0.2126, 0.7152, 0.0722);
    float shining = cosine > 0.0 ? lit : 0.0;
    float other = dot(luminance, ambient) * ambient_open;
#ifdef LAMPS
    other += dot(luminance, lamplight(eye + ray_of(s) * depth, face, face, face, vec3(1.0), vec3(0.0), 1.0, 0.0));
#endif
    out_received = vec4(dot(luminance, sun) * shining * max(cosine, 0.0), other, shining, depth);
}
#else
void main() {
    ivec2 place = ivec2(gl_FragCoord.xy);
#ifdef PLAIN
    ivec2 s = place * 2;
    float window = texelFetch(plain_depth, place, 0).r;
    vec3 ray = ray_through(gl_FragCoord.xy * 2.0);
#else
    ivec2 s = place;
    float window = texelFetch(depth_map, s, 0).r;
    vec3 ray = ray_of(s);
#endif
    // A CPU rasteriser executes all branches for every sample. The sky is therefore computed once, for a view or a reflection.
    bool sample_is_sky = window == 1.0;
    vec3 d = normalize(ray);
    float depth = linear_depth(window);
    vec3 p = eye + ray * depth;
    vec4 stored = texelFetch(albedo_map, place, 0);
    vec3 albedo = stored.rgb * stored.rgb;
    vec4 normals = texelFetch(normals_map, place, 0);
    vec3 normal = octahedron_decode(normals.xy), face = octahedron_decode(normals.zw);
    uvec2 material = texelFetch(material_map, place, 0).rg;
    int row = int(material.x);
    vec4 surface = texelFetch(material_table, ivec2(1, row), 0);
    vec4 glow = texelFetch(material_table, ivec2(2, row), 0);
    vec2 factors = unpacked_factors(material.y);
    surface.xy *= factors;
    float roughness = clamp(surface.x, 0.04, 1.0), metallic = surface.y, translucency = max(glow.a, 0.0);
    // A room behind a pane is lit by its lamps only, if they are on.
    float own = glow.a < 0.0 ? factors.y : 0.0;
    // Double glazing has twice the surfaces.
    float panes = glow.a < 0.0 ? GLAZING : 1.0;

    ivec2 pixel = nearest_cell(s, depth, SKYLIGHT_CELL);

#if defined(RAIN) || defined(SNOW) || defined(LEAVES)
    float grain = grain_of(depth, abs(dot(face, d)));
#endif
#if defined(SNOW) || defined(LEAVES)
    // Nothing lies on movables, which are in front of the statics.
    bool is_static = texelFetch(mirror_depth, s, 0).r - texelFetch(depth_map, s, 0).r < ROUNDED_DEPTH && !sample_is_sky;
    float traffic = texelFetch(material_table, ivec2(4, row), 0).a;
#endif
#ifdef SNOW
    Snow snow = snow_at(p, face, open_above(pixel), traffic, roughness, albedo, grain);
    snow.cover = is_static ? snow.cover : 0.0;
#endif
#ifdef LEAVES
    float strewn = is_static && translucency == 0.0 ? leaf_litter * smoothstep(LEAVES_LIE.x, LEAVES_LIE.y, face.z) : 0.0;
    // Wind and feet gather leaves in patches.
    strewn *= (1.0 - LEAVES_TAKEN.x * traffic) * (1.0 - LEAVES_TAKEN.y * swept(traffic, roughness, albedo));
    if (strewn > 0.0) {
        vec4 litter = leaves_at(p, clamp(strewn * 2.0 * relief(p.xy / LEAVES_PATCH, 30.0).x, 0.0, 1.0), grain);
        albedo = mix(albedo, litter.rgb, litter.a);
        roughness = mix(roughness, LEAVES_ROUGHNESS, litter.a);
        metallic *= 1.0 - litter.a;
        normal = normalize(mix(normal, face, 0.7 * litter.a));
    }
#endif

#ifdef RAIN
    // Pores full of water darken a surface (Lekner and Dorf 1988, doi:10.1364/AO.27.001278). Standing water is smooth and level,
    // with the reflectance of water at normal incidence. A film keeps most of the relief. What water sinks into does not mirror.
    float soaks = texelFetch(material_table, ivec2(5, row), 0).a;
    Water water = water_at(p, face, soaks, roughness, grain);
    float film = water.film * (1.0 - metallic), pool = water.pool * (1.0 - metallic);
    albedo *= mix(1.0, WATER_DARKENS, film * smoothstep(WATER_PORES.x, WATER_PORES.y, roughness));
    float smoothed = mix(min(roughness, WATER_ROUGHNESS.x), WATER_ROUGHNESS.y * roughness, soaks);
    roughness = mix(roughness, mix(smoothed, WATER_ROUGHNESS.z, pool), film);
    surface.z = mix(surface.z, max(surface.z, WATER_SPECULAR), max(film * (1.0 - soaks), pool));
    normal = normalize(mix(normal, face, max(film * WATER_FILLS * (1.0 - soaks), pool)) + vec3(water.ripples * pool, 0.0));
    film = max(film * (1.0 - soaks), pool);
#endif
#ifdef SNOW
    if (is_static) {
        // Melt water wets the bare tracks. Snow stands higher than the bare ground at its edge, and shades it.
        float damp = traffic * (1.0 - snow.cover) * snow.dirt * smoothstep(0.0, SNOW_DAMP, snow_depth);
        albedo *= mix(1.0, SNOW_DAMP_ALBEDO, damp) * (1.0 - SNOW_SHADES * snow.shore);
        roughness = mix(roughness, SNOW_DAMP_ROUGHNESS.x, SNOW_DAMP_ROUGHNESS.y * damp);
        albedo = mix(albedo, mix(SNOW_WHITE, SNOW_SLUSH, snow.dirt), snow.cover);
        roughness = mix(roughness, SNOW_ROUGHNESS, snow.cover);
        metallic *= 1.0 - snow.cover;
        surface.z = mix(surface.z, SNOW_SPECULAR, snow.cover);
        surface.w *= 1.0 - snow.cover;
        translucency *= 1.0 - snow.cover;
        normal = normalize(mix(normal, snow.normal, snow.cover));
#ifdef RAIN
        film *= 1.0 - snow.cover;
#endif
    }
#endif

    float luminance = dot(albedo, vec3(0.2126, 0.7152, 0.0722));
    vec3 tint = luminance > 0.0 ? albedo / luminance : vec3(1.0);
    vec3 f0 = mix(0.04 * panes * surface.z * mix(vec3(1.0), tint, surface.w), albedo, metallic);
    vec3 view = -d;
    float facing = max(dot(normal, view), 1e-3);
    // Specularly reflected light does not reach the diffuse surface below.
    vec3 mirrored_share = environment_reflectance(f0, roughness, facing);
    vec3 diffuse = albedo * (1.0 - metallic) * (1.0 - own) * (1.0 - mirrored_share);
    float cosine = dot(normal, toward_sun), face_cosine = dot(face, toward_sun);

    // Sun. A face turned away gets none, whatever its normal map says. Thin sheets transmit a share.
    float front = max(cosine, 0.0) * smoothstep(0.0, 0.08, face_cosine);
    float behind = max(-cosine, 0.0);
    float lit = sunlit(p, face, depth, front + translucency * behind > 0.0);
    vec3 color = diffuse * sun * (lit * mix(front, behind, translucency));
    vec3 h = normalize(view + toward_sun);
    float nh = max(dot(normal, h), 0.0);
    float alpha = max(roughness * roughness, 0.01);
    float k = nh * nh * (alpha * alpha - 1.0) + 1.0;
    float distribution = alpha * alpha / (k * k);                               // π D, Walter et al. 2007
    float v = 0.5 / mix(2.0 * max(cosine, 0.0) * facing, max(cosine, 0.0) + facing, alpha);  // Hammon 2017
    float grazing = 1.0 - max(dot(view, h), 0.0);
    vec3 fresnel = f0 + (1.0 - f0) * (grazing * grazing * grazing * grazing * grazing);
    color += fresnel * sun * (lit * front * distribution * v);

    // Sky.
    vec4 red = texelFetch(skylight_red, pixel, 0), green = texelFetch(skylight_green, pixel, 0);
    vec4 blue = texelFetch(skylight_blue, pixel, 0);
#ifdef PLAIN
    float ambient_open = texelFetch(occlusion_map, place, 0).r;
#else
    float ambient_open = texelFetch(occlusion_map, nearest_cell(s, depth, 2), 0).r;
#endif
    vec3 zonal = texelFetch(skylight_zonal, pixel, 0).rgb;
    vec3 ambient = skylight(red, green, blue, zonal, normal), ambient_behind = skylight(red, green, blue, zonal, -normal);
    vec3 skylit = diffuse * ambient_open * mix(ambient, ambient_behind, translucency);
#ifdef SNOW
    // Light that went far through snow is blue.
    skylit *= mix(vec3(1.0), SNOW_DEPTHS, snow.cover * (1.0 - snow.dirt));
#endif
    color += skylit;

    vec3 r = reflect(d, normal);
    // A rough lobe is nearer to the normal than the mirrored ray (Lagarde and de Rousiers 2014, "Moving Frostbite to physically
    // based rendering"), less so at grazing angles.
    float smoothness = 1.0 - alpha;
    float toward = smoothness * (sqrt(smoothness) + alpha) + 0.46 * alpha * alpha * (1.0 - facing);
    vec3 lobe = normalize(mix(normal, r, toward));
    vec3 blurred = skylight(red, green, blue, zonal, lobe);
    vec3 above = sky(sample_is_sky ? d : vec3(r.xy, abs(r.z)));
    float rough = smoothstep(0.08, 0.55, roughness);
    vec3 around = surroundings(r, pixel, above, rough < 1.0);
    // Smooth surfaces mirror shapes, others only the mean light from each direction.
    float sharp = panorama_known * (1.0 - smoothstep(0.25, 0.4, roughness));
#ifdef RAIN
    sharp *= 1.0 - film;
#endif
    vec4 pane = in_pane(p, face, r, sharp > 0.0 && roughness < 0.2);
    vec3 image_of = captured(p, r, around, smoothstep(0.06, 0.26, roughness), sharp > 0.0 && pane.a == 0.0);
    image_of = mix(image_of, pane.rgb, pane.a);
    vec3 environment = mix(mix(around, blurred, rough), image_of, sharp);
#ifdef RAIN
    // At grazing angles the lobe of a film is elongated, so it covers more of the sky at a lower roughness than above.
    vec3 wide = mix(above, blurred, smoothstep(0.06, 0.45, roughness));
    // A microfacet turns the ray by twice its own angle.
    float still = pool / max(film, 1e-3);
    float spread = 3.5 * mix(length(vec2(alpha, FILM_SLOPES)), alpha, still);
    vec4 image = mirrored(p, normalize(vec3(r.xy, max(abs(r.z), 0.01))), spread, wide, film > 0.0);
    image.rgb = mix(around, image.rgb, image.a);
#ifdef MOVABLES
    float level = smoothstep(WATER_STANDS.x, WATER_STANDS.y, face.z);
    vec4 figure = mirrored_movables(p, d, spread, film * level > 0.0 && d.z < 0.0);
    image.rgb = mix(image.rgb, figure.rgb, figure.a * level);
#endif
    environment = mix(environment, mix(image.rgb, blurred, FILM_SCATTERS * (1.0 - still)), film);
#endif
    color += environment * mirrored_share * mix(1.0, ambient_open, 0.8);

#ifdef LAMPS
    color += lamplight(p, normal, face, view, diffuse, f0, roughness, translucency);
#endif
    color += emitted(glow, own * albedo * (1.0 - mirrored_share));
    vec3 clear_air = exp(-extinction * length(p - eye));
    color = mix(haze, color, clear_air);
    color = sample_is_sky ? above + sun_disc(d) * panorama_known : color;
#ifdef RAIN
    color = through_rain(color);
#endif
#ifdef FLAKES
    color = through_flakes(color);
#endif
    // The sun keeps its hue.
    float brightest = max(max(color.r, color.g), max(color.b, 1.0));
    color = sample_is_sky ? color * min(1.0, BRIGHTEST_SKY / brightest) : min(color, vec3(BRIGHTEST));
    out_radiance = vec4(color, stored.a);
}
#endif
