// Light of lamps: inverse square falloff within a cone, windowed to end at the lamp's reach, with shadow maps for some lamps.
uniform sampler2D lamp_table;       // rows: see LampLight.table
uniform int lamp_count;
uniform sampler2D static_lamps;     // statics seen from static lamps: tiles of LAMP_MAP² texels, LAMP_ACROSS per row
#ifdef MOVING_LAMPS
uniform sampler2D moving_lamps;     // statics seen from lamps on movables: the tiles from LAMP_TILES on
const int STILL_TEXELS = LAMP_TILES / LAMP_ACROSS * LAMP_MAP;
#endif
#ifdef MOVABLES
uniform sampler2D movable_lamps;    // movables seen from both: all tiles
#endif
uniform mat4 lamp_clip[LAMP_TILES + MOVING_TILES];
const int LAMP_TAPS = 6;

#ifdef DIPPED
uniform vec2 dipped_spread;
uniform vec3 dipped_cut_off;        // rise, edge, stray

// Share of a dipped beam's intensity in the direction ``away`` from the lamp; see beams.py.
float dipped(vec3 away, vec3 axis, vec3 up) {
    vec2 tangents = vec2(dot(away, cross(axis, up)), dot(away, up)) / max(dot(away, axis), 1e-3);
    float below = dipped_cut_off.x * max(tangents.x, 0.0) - tangents.y;
    float cut = mix(dipped_cut_off.z, 1.0, smoothstep(0.0, dipped_cut_off.y, below));
    vec2 off = tangents / dipped_spread;
    vec2 falloff = 1.0 + off * off;
    float both = falloff.x * falloff.y;
    return cut / (both * both);
}
#endif

// Share of a lamp's light that reaches a place. Places outside the map are lit. For the loop, see shadow.glsl.
float lamp_visibility(vec3 p, vec3 face, int tile, float texel, float turn) {
    vec4 at = lamp_clip[max(tile, 0)] * vec4(p, 1.0);
    // An offset of two texels along the normal prevents self-shadowing.
    at = lamp_clip[max(tile, 0)] * vec4(p + face * (0.01 + 2.0 * texel * at.w), 1.0);
    vec3 ndc = at.xyz / max(at.w, 1e-3);
    bool inside = tile >= 0 && at.w > 0.0 && all(lessThan(abs(ndc), vec3(1.0)));
    vec2 place = (ndc.xy * 0.5 + 0.5) * float(LAMP_MAP);
    ivec2 corner = ivec2(tile % LAMP_ACROSS, tile / LAMP_ACROSS) * LAMP_MAP;
    float depth = ndc.z * 0.5 + 0.5;
    float hidden = 0.0;
    vec2 way = direction(turn);
    int i = 0, taps = inside ? LAMP_TAPS : 1;
    do {
        vec2 o = way * (1.5 * sqrt((float(i) + 0.5) / float(LAMP_TAPS)));
        way = GOLDEN * way;
        ivec2 s = corner + clamp(ivec2(place + o), ivec2(0), ivec2(LAMP_MAP - 1));
#ifdef MOVING_LAMPS
        float still = texelFetch(static_lamps, ivec2(s.x, min(s.y, textureSize(static_lamps, 0).y - 1)), 0).r;
        float moving = texelFetch(moving_lamps, ivec2(s.x, max(s.y - STILL_TEXELS, 0)), 0).r;
        float nearest = tile < LAMP_TILES ? still : moving;
#else
        float nearest = texelFetch(static_lamps, s, 0).r;
#endif
#ifdef MOVABLES
        nearest = min(nearest, texelFetch(movable_lamps, s, 0).r);
#endif
        hidden += inside && nearest < depth ? 1.0 : 0.0;
    } while (++i < taps);
    return 1.0 - hidden / float(LAMP_TAPS);
}

// Radiance by all lamps, at least one: diffuse reflection, transmission of thin sheets, and highlights with the sun's microfacet model.
vec3 lamplight(vec3 p, vec3 normal, vec3 face, vec3 view, vec3 diffuse, vec3 f0, float roughness, float translucency) {
    vec3 sum = vec3(0.0);
    float facing = max(dot(normal, view), 1e-3);
    float alpha = max(roughness * roughness, 0.01);
    float turn = gradient_noise(gl_FragCoord.xy) * 6.2831853;
    int k = 0;
    do {
        vec4 place = texelFetch(lamp_table, ivec2(0, k), 0), axis = texelFetch(lamp_table, ivec2(1, k), 0);
        vec3 way = place.xyz - p;
        float squared = max(dot(way, way), 1e-4);
        vec3 l = way * inversesqrt(squared);
        float window = squared * place.w;
        float along = -dot(l, axis.xyz) - axis.w;
        float cosine = dot(normal, l), face_cosine = dot(face, l);
        float front = max(cosine, 0.0) * smoothstep(0.0, 0.08, face_cosine);
        float diffused = mix(front, max(-cosine, 0.0), translucency);
        if (window < 1.0 && along > 0.0 && front + diffused > 0.0) {
            vec4 strength = texelFetch(lamp_table, ivec2(2, k), 0), shadow = texelFetch(lamp_table, ivec2(3, k), 0);
            float spot = min(along * strength.w, 1.0), ends = 1.0 - window * window;
            float visibility = lamp_visibility(p, face, int(shadow.x), shadow.y, turn);
#ifdef DIPPED
            vec4 up = texelFetch(lamp_table, ivec2(4, k), 0);
            spot *= up.w > 0.0 ? sqrt(dipped(-l, axis.xyz, up.xyz)) : 1.0;
#endif
            vec3 light = strength.rgb * (spot * spot * ends * ends * visibility / max(squared, 0.01));
            vec3 h = normalize(view + l);
            float nh = max(dot(normal, h), 0.0), lobe = nh * nh * (alpha * alpha - 1.0) + 1.0;
            float v = 0.5 / mix(2.0 * max(cosine, 0.0) * facing, max(cosine, 0.0) + facing, alpha);
            vec3 fresnel = f0 + (1.0 - f0) * pow(1.0 - max(dot(view, h), 0.0), 5.0);
            sum += diffuse * light * diffused;
            sum += fresnel * light * (front * v * alpha * alpha / (lobe * lobe));
        }
    } while (++k < lamp_count);
    return sum;
}
