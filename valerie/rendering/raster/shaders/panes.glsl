// Reflections in large flat panes: a picture of the statics from the camera's mirror image (panes.py).
uniform sampler2D pane_image;   // radiance, depth in metres (0 where unknown)
uniform vec4 pane_plane;        // normal, and its product with a point of the plane
uniform float pane_near;        // largest distance of a pane from the plane, metres; 0 without a picture
uniform vec3 pane_eye;
uniform mat3 pane_basis;        // to x and y at the picture's edges times depth, and depth of a vector from the eye
uniform vec2 pane_size;         // texels

const int PANE_STEPS = 4;

// Radiance at p from direction r, and 1 where the picture shows it, else 0. ``face`` is the normal of the pane at p.
vec4 in_pane(vec3 p, vec3 face, vec3 r, bool wanted) {
    wanted = wanted && abs(dot(pane_plane.xyz, p) - pane_plane.w) < pane_near && dot(face, pane_plane.xyz) > 0.999;
    vec3 from = pane_basis * (p - pane_eye), way = pane_basis * r;
    vec2 place = from.xy / from.z;
    // The picture shows what an even pane mirrors at its place in the pane. Where a bent pane shows it follows from its depth.
    int i = 0, steps = wanted ? PANE_STEPS : 1;
    do {
        ivec2 texel = clamp(ivec2((place * 0.5 + 0.5) * pane_size), ivec2(0), ivec2(pane_size) - 1);
        float depth = texelFetch(pane_image, texel, 0).a;
        vec3 x = from + max(depth - from.z, 0.0) / max(way.z, 1e-3) * way;
        place = x.xy / x.z;
    } while (++i < steps);
    vec2 texel = (place * 0.5 + 0.5) * pane_size;
    vec4 seen = textureLod(pane_image, clamp(texel, vec2(0.5), pane_size - 0.5) / vec2(textureSize(pane_image, 0)), 0.0);
    bool known = wanted && all(greaterThan(texel, vec2(0.0))) && all(lessThan(texel, pane_size)) && seen.a > 0.0;
    return vec4(seen.rgb, known ? 1.0 : 0.0);
}
