// Rooms behind panes, without geometry: the ray behind the pane ends at a wall of an imaginary box (van Dongen 2008, "Interior
// mapping", Computer Graphics International), whose picture is a texture in perspective. See Rooms in model.py, and
// surface_constants.py for the constants.
uniform sampler2DArray room_textures;
uniform vec3 eye;

// Colour (sRGB) behind the pane, and 1 where lamps light the room, else 0. The shading normal is that of the bent glass. ``du`` and
// ``dv`` are the steps in uv to the next sample to the right and above.
vec4 behind_pane(vec3 normal, vec2 du, vec2 dv, float slant, out vec3 shading) {
    // Sides of a cell in the world, from screen derivatives.
    vec3 dx = dFdx(world_position), dy = dFdy(world_position);
    float area = du.x * dv.y - du.y * dv.x;
    area = abs(area) < 1e-20 ? 1e-20 : area;
    float cells = float(ROOM_CELLS);
    vec3 right = (dx * dv.y - dy * du.y) / (area * cells), down = (dy * du.x - dx * dv.x) / (area * cells);
    vec2 size = 2.0 * ROOM_FRONT * vec2(length(right), length(down));
    right = normalize(right);
    down = normalize(down);
    vec2 cell = floor(uv * cells), at = (uv * cells - cell - 0.5) / (2.0 * ROOM_FRONT);

    vec3 ray = normalize(world_position - eye);
    vec3 d = vec3(dot(ray, right), dot(ray, down), max(-dot(ray, normal), 1e-3));
    // The box: the middle of the pane is 0, down is positive.
    float top = -0.5 * size.y - ROOM_CEILING, base = max(0.5 * size.y, ROOM_STOREY - 0.5 * size.y);
    vec3 rooms = material_texel(5).xyz;
    vec2 extent = 0.5 * vec2(max(rooms.y, ROOM_PANES * size.x), base - top), middle = vec2(0.0, 0.5 * (base + top));
    vec2 from = (at * size - middle) / extent;
    vec3 way = d / vec3(extent, rooms.z);
    vec3 ends = vec3((vec2(1.0) - from * sign(way.xy)) / max(abs(way.xy), 1e-5), 1.0 / way.z);
    float t = min(min(ends.x, ends.y), ends.z);
    vec3 hit = vec3(from, 0.0) + t * way;
    vec2 seen = clamp(hit.xy / (1.0 + hit.z), -1.0, 1.0);

    float layer = rooms.x;
    vec2 place = (cell + 0.5 + ROOM_FRONT * seen) / (2.0 * cells);
    vec2 hung = clamp(at + d.xy / d.z * ROOM_HANGS / size, -0.5, 0.5);
    vec2 cloth = (cell + 0.5 + 2.0 * ROOM_FRONT * hung) / (2.0 * cells);
    float level = -min(slant, 1.6);
    vec4 by_lamps = texture(room_textures, vec3(place + vec2(0.5, 0.0), layer), level);
    float lamps = material_texel(2).r > 0.0 ? step(0.5, by_lamps.a) : 0.0;
    vec4 room = lamps > 0.0 ? by_lamps : texture(room_textures, vec3(place, layer), level);
    vec4 front = texture(room_textures, vec3(cloth + vec2(lamps * 0.5, 0.5), layer), level);

    vec2 turns = fract(cell * vec2(0.618, 0.755) + cell.yx * vec2(0.570, 0.380));
    vec2 slope = 0.5 * GLASS_BENT * (sin(6.2831853 * (at * vec2(1.0, 0.7) + turns)) + 2.0 * turns.yx - 1.0);
    shading = normalize(normal + slope.x * right + slope.y * down);
    return vec4(mix(room.rgb, front.rgb, front.a), lamps);
}
