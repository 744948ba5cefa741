// Snow (with the constants of surface_constants.py) and fallen leaves on static surfaces that face up. They have no thickness: depth and labels stay those of the surface.
uniform float snow_depth;           // metres
uniform float leaf_litter;          // covered share of level ground

#ifdef LEAVES
// Share of the leaves on a surface that wheels and feet remove: where they have polished it. Markings are smooth too, but bright.
float swept(float traffic, float roughness, vec3 albedo) {
    return traffic * (1.0 - smoothstep(LEAVES_TRACK.x, LEAVES_TRACK.y, roughness)) * (1.0 - smoothstep(SNOW_MARKING.x, SNOW_MARKING.y, albedo.g));
}
#endif

#ifdef SNOW
// Share of the sky around the zenith that nothing hides.
float open_above(ivec2 cell) {
    ivec2 zenith = textureSize(direction_shares, 0) / 2;
    uvec4 nearest = texelFetch(nearest_directions, zenith, 0);
    vec4 shares = texelFetch(direction_shares, zenith, 0);
    uvec4 first = texelFetch(openness_first, cell, 0), second = texelFetch(openness_second, cell, 0);
    vec4 open = vec4(
        open_toward(nearest.x, first, second), open_toward(nearest.y, first, second),
        open_toward(nearest.z, first, second), open_toward(nearest.w, first, second));
    return dot(shares, open) / dot(shares, vec4(1.0));
}

struct Snow {
    float cover;                    // share of the surface that it hides
    float dirt;                     // share of slush
    float shore;                    // share of a bare place that the edge of snow beside it darkens
    vec3 normal;
};

// Snow on a face. Its patches have random borders; over large areas their mean is tanh(depth / 25 mm), see weather.py, since the
// noise is turned into evenly distributed ranks. The same noise bends the surface, so that borders and dunes have a height.
Snow snow_at(vec3 p, vec3 face, float open, float traffic, float roughness, vec3 albedo, float grain) {
    float height = 0.0, spread = 0.0, visible = 0.0;
    vec2 dunes = vec2(0.0), border = vec2(0.0);
    for (int i = 0; i < 4; ++i) {
        float weight = SNOW_WEIGHTS[i] * seen(SNOW_LENGTHS[i], grain);
        vec3 layer = relief(p.xy / SNOW_LENGTHS[i], float(i));
        height += weight * (layer.x - 0.5);
        border += weight / SNOW_LENGTHS[i] * layer.yz;
        dunes += weight * layer.yz;
        spread += weight * weight;
        visible += weight;
    }
    // Tyres polish asphalt, but less than oil and bitumen are smooth. Markings are bright. Tracks have ragged edges.
    float polish = roughness - SNOW_RAGGED.y * height, driven = traffic * smoothstep(SNOW_DRIVEN.x, SNOW_DRIVEN.y, roughness);
    float worn = driven * (1.0 - smoothstep(SNOW_TRACK.x, SNOW_TRACK.y, polish));
    worn *= 1.0 - smoothstep(SNOW_MARKING.x, SNOW_MARKING.y, albedo.g);
    // Snow slides off steep surfaces and does not fall below others. Traffic compacts it.
    float slope = smoothstep(SNOW_SLOPE.x, SNOW_SLOPE.y, face.z + SNOW_RAGGED.x * height * (1.0 - face.z));
    float depth = snow_depth * slope * open * (1.0 - SNOW_TAKEN.x * traffic) * (1.0 - SNOW_TAKEN.y * worn);
    float cover = 1.0 - 2.0 / (exp(2.0 * depth / SNOW_COVERING) + 1.0);
    // The logistic curve is that of a normal distribution within 0.01.
    float steep = 1.702 / (RELIEF_DEVIATION * sqrt(max(spread, 1e-6)));
    float rank = 1.0 / (1.0 + exp(-steep * height));
    // Within [0, 1], a border of any softness keeps the mean.
    float soft = max(min(SNOW_SOFT, min(cover, 1.0 - cover)), 1e-4), inside = (cover - rank) / soft;
    float sharp = mix(cover, smoothstep(-1.0, 1.0, inside), min(visible, 1.0));
    // Towards a border the snow thins out: a slope towards higher ranks, of a layer some centimetres thick.
    float edge = 1.0 - min(inside * inside, 1.0), thickness = min(0.5 * depth, SNOW_THICKNESS);
    vec2 fall = border * (edge * thickness * steep * rank * (1.0 - rank) / soft);
    fall *= min(1.0, SNOW_STEEPEST / max(length(fall), 1e-4));
    vec3 rounded = normalize(mix(face, vec3(0.0, 0.0, 1.0), SNOW_ROUNDS * sharp));
    vec2 bumps = dunes * (SNOW_DUNES.x + SNOW_DUNES.y * traffic);
    float slush = driven * (1.0 - smoothstep(SNOW_SLUSHY.x, SNOW_SLUSHY.y, polish));
    return Snow(
        sharp, clamp(max(SNOW_DIRT.x * traffic, SNOW_DIRT.y * slush) + worn, 0.0, 1.0),
        (1.0 - sharp) * smoothstep(-3.0, -1.0, inside) * min(visible, 1.0), normalize(rounded + vec3(fall - bumps, 0.0)));
}
#endif

#ifdef LEAVES
// Leaves at a place: their colour, and the share that they hide. Each cell of a layer holds at most one leaf.
vec4 leaves_at(vec3 p, float cover, float grain) {
    vec4 leaves = vec4(0.0);
    // A leaf fills a quarter of its cell. Four layers with this chance of a leaf hide ``cover`` together.
    float chance = min((1.0 - pow(1.0 - cover, 0.25)) / 0.25, 1.0);
    for (int i = 0; i < 4; ++i) {
        float layer = float(i), side = LEAVES_CELL.x + LEAVES_CELL.y * layer, turn = LEAVES_TURN.x + LEAVES_TURN.y * layer;
        vec2 at = mat2(cos(turn), sin(turn), -sin(turn), cos(turn)) * p.xy / side;
        vec3 cell = vec3(floor(at), layer);
        float angle = 6.2831853 * random_of(cell + 3.0), kind = random_of(cell + 5.0), tone = random_of(cell + 7.0);
        vec2 off = fract(at) - 0.5 - 0.16 * (vec2(random_of(cell + 11.0), random_of(cell + 13.0)) - 0.5);
        off = vec2(dot(off, direction(angle)), dot(off, direction(angle + 1.5707963)));
        // An oval with a tip at one end; its half width falls to 0 there.
        float along = clamp(off.x / 0.42 * 0.5 + 0.5, 0.0, 1.0);
        float width = 0.30 * sqrt(along) * (1.0 - along * along) * (0.75 + 0.5 * kind) * 1.25;
        float soft = clamp(0.5 * grain / side, 0.02, 0.08);    // wider borders would enlarge the leaf
        float inside = (1.0 - smoothstep(-soft, soft, abs(off.y) - width)) * step(abs(off.x), 0.42);
        inside *= random_of(cell) < chance ? 1.0 : 0.0;
        vec3 color = mix(mix(LEAVES_BROWN, LEAVES_RUST, smoothstep(0.2, 0.5, kind)), LEAVES_YELLOW, smoothstep(0.55, 0.8, kind));
        // A pale midrib, and darker patches of decay.
        color *= (0.55 + 0.7 * tone) * (1.0 + 0.5 * (1.0 - smoothstep(0.008, 0.03, abs(off.y))));
        color *= 1.0 - 0.35 * relief(p.xy / LEAVES_DECAY, layer + 20.0).x * seen(LEAVES_DECAY, grain);
        leaves = mix(leaves, vec4(color, 1.0), inside);
    }
    vec4 far = vec4(mix(LEAVES_RUST, LEAVES_YELLOW, 0.4) * 0.85 * cover, cover);
    leaves = mix(far, leaves, seen(0.25, grain));
    return vec4(leaves.rgb / max(leaves.a, 1e-3), leaves.a);
}
#endif
