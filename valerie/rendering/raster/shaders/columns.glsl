// The lowest and the highest surface of the movables over each place of the ground.
uniform sampler2D columns;
uniform vec2 columns_origin;   // low corner of the map, metres
uniform vec2 columns_extent;

// Heights over a place, metres; where nothing stands, the lowest is far above the highest.
vec2 column(vec2 at) {
    vec2 t = (at - columns_origin) / columns_extent;
    ivec2 size = textureSize(columns, 0);
    vec2 heights = texelFetch(columns, clamp(ivec2(t * vec2(size)), ivec2(0), size - 1), 0).rg;
    bool inside = all(greaterThan(t, vec2(0.0))) && all(lessThan(t, vec2(1.0)));
    return vec2(-1.0, 1.0) * (inside ? heights : vec2(-float(NO_COLUMN)));
}
