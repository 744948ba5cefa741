// Snow and fallen leaves on static surfaces that face up. They have no thickness: depth and labels stay those of the surface.
uniform float snow_depth;           // metres
uniform float leaf_litter;          // covered share of level ground

// Height of a smooth random surface in [0, 1] with cells of unit length, and its slopes along x and y.
vec3 relief(vec2 p, float layer) {
    vec2 cell = floor(p), t = p - cell;
    vec2 s = t * t * (3.0 - 2.0 * t), slope = 6.0 * t * (1.0 - t);
    float a = random_of(vec3(cell, layer)), b = random_of(vec3(cell + vec2(1.0, 0.0), layer));
    float c = random_of(vec3(cell + vec2(0.0, 1.0), layer)), d = random_of(vec3(cell + 1.0, layer));
    float twist = a - b - c + d;
    return vec3(a + (b - a) * s.x + (c - a) * s.y + twist * s.x * s.y, slope * (vec2(b, c) - a + twist * s.yx));
}

// Metres of ground that a pixel at p covers along the view: details shorter than that are replaced by their mean.
float grain_of(float depth, float facing) {
    return 4.0 * depth * length(ray_basis[1]) / float(sample_size.y) / max(facing, 0.05);
}

float seen(float length_of, float grain) {
    return 1.0 - smoothstep(0.25 * length_of, length_of, grain);
}

// Share of what lies on a surface that wheels and feet remove: where they have polished it. Markings are smooth too, but bright.
float swept(float traffic, float roughness, vec3 albedo) {
    return traffic * (1.0 - smoothstep(0.79, 0.87, roughness)) * (1.0 - smoothstep(0.16, 0.26, albedo.g));
}

// Share of the surface at p that ``cover`` of lying material hides. Patches have random borders; over large areas their mean is
// ``cover``, since the noise is turned into evenly distributed ranks.
float patched(vec2 p, float cover, float grain) {
    const vec4 LENGTHS = vec4(1.6, 0.4, 0.1, 0.03), WEIGHTS = vec4(0.36, 0.27, 0.2, 0.17);
    float height = 0.0, spread = 0.0, visible = 0.0;
    for (int i = 0; i < 4; ++i) {
        float weight = WEIGHTS[i] * seen(LENGTHS[i], grain);
        height += weight * (relief(p / LENGTHS[i], float(i)).x - 0.5);
        spread += weight * weight;
        visible += weight;
    }
    // The standard deviation of a layer is 0.21. The logistic curve is that of a normal distribution within 0.01.
    float rank = 1.0 / (1.0 + exp(-1.702 * height / (0.21 * sqrt(max(spread, 1e-6)))));
    // Within [0, 1], a border of any softness keeps the mean.
    float soft = max(min(0.2, min(cover, 1.0 - cover)), 1e-4);
    float sharp = smoothstep(-soft, soft, cover - rank);
    return mix(cover, sharp, min(visible, 1.0));
}

#ifdef SNOW
// Cover of snow at a place, x, and how dirty it is, y.
vec2 snow_at(vec3 p, vec3 face, float open, float traffic, float worn, float grain) {
    // Snow slides off steep surfaces and does not fall below others. Traffic compacts it.
    float depth = snow_depth * smoothstep(0.3, 0.75, face.z) * open * (1.0 - 0.5 * traffic) * (1.0 - 0.94 * worn);
    // tanh(depth / 25 mm), see weather.py
    float cover = 1.0 - 2.0 / (exp(2.0 * depth / 0.025) + 1.0);
    return vec2(patched(p.xy, cover, grain), traffic * (0.2 + 0.8 * worn));
}

// Normal of snow on a face: dunes some decimetres long, and grains.
vec3 snow_normal(vec3 p, vec3 face, float grain) {
    vec2 slope = 0.05 * seen(0.6, grain) * relief(p.xy / 0.6, 5.0).yz + 0.07 * seen(0.12, grain) * relief(p.xy / 0.12, 6.0).yz
        + 0.10 * seen(0.03, grain) * relief(p.xy / 0.03, 7.0).yz;
    return normalize(face - vec3(slope, 0.0));
}
#endif

#ifdef LEAVES
// Leaves at a place: their colour, and the share that they hide. Each cell of a layer holds at most one leaf.
vec4 leaves_at(vec3 p, float cover, float grain) {
    const vec3 YELLOW = vec3(0.42, 0.27, 0.045), RUST = vec3(0.26, 0.105, 0.03), BROWN = vec3(0.115, 0.065, 0.03);
    vec4 leaves = vec4(0.0);
    // A leaf fills a quarter of its cell. Four layers with this chance of a leaf hide ``cover`` together.
    float chance = min((1.0 - pow(1.0 - cover, 0.25)) / 0.25, 1.0);
    for (int i = 0; i < 4; ++i) {
        float layer = float(i), side = 0.12 + 0.02 * layer, turn = 0.4 + 0.7 * layer;
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
        vec3 color = mix(mix(BROWN, RUST, smoothstep(0.2, 0.5, kind)), YELLOW, smoothstep(0.55, 0.8, kind));
        // A pale midrib, and darker patches of decay.
        color *= (0.55 + 0.7 * tone) * (1.0 + 0.5 * (1.0 - smoothstep(0.008, 0.03, abs(off.y))));
        color *= 1.0 - 0.35 * relief(p.xy / 0.025, layer + 20.0).x * seen(0.025, grain);
        leaves = mix(leaves, vec4(color, 1.0), inside);
    }
    vec4 far = vec4(mix(RUST, YELLOW, 0.4) * 0.85 * cover, cover);
    leaves = mix(far, leaves, seen(0.25, grain));
    return vec4(leaves.rgb / max(leaves.a, 1e-3), leaves.a);
}
#endif
