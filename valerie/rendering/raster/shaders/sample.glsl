// Position in the world of a sample of the G-buffer (two by two per pixel).
uniform sampler2D depth_map;   // window depth, 1 where nothing was drawn
uniform ivec2 sample_size;     // size of the G-buffer
uniform vec2 near_far;
uniform vec3 eye;
uniform mat3 ray_basis;        // columns: right and up at the image's edge, forward, at depth 1

// Window depths of the same surface differ by less between the passes with and without the movables.
const float ROUNDED_DEPTH = 3e-7;

float linear_depth(float window) {
    // 1 − window has no rounding error.
    return near_far.x * near_far.y / (near_far.x * window + near_far.y * (1.0 - window));
}

// Ray through a place in the image, counted in samples, with depth 1 along the optical axis.
vec3 ray_through(vec2 place) {
    return ray_basis * vec3(place / vec2(sample_size) * 2.0 - 1.0, 1.0);
}

// Ray through the centre of a sample.
vec3 ray_of(ivec2 s) {
    return ray_through(vec2(s) + 0.5);
}

// Interleaved gradient noise (Jimenez 2014, "Next generation post processing in Call of Duty: Advanced Warfare").
float gradient_noise(vec2 p) {
    return fract(52.9829189 * fract(dot(p, vec2(0.06711056, 0.00583715))));
}
