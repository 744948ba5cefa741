// Reflections in large flat panes: pictures of the statics from the camera's mirror images (panes.py).
uniform sampler2DArray pane_images;     // radiance, depth in metres (0 where unknown)
uniform int pane_count;
uniform vec4 pane_planes[PANE_IMAGES];  // normal, and its product with a point of the plane
uniform vec3 pane_eyes[PANE_IMAGES];
uniform vec3 pane_rows[3 * PANE_IMAGES];// x and y at the picture's edges times depth, and depth of a vector from the eye
uniform vec2 pane_sizes[PANE_IMAGES];   // texels

const float PANE_SAME = 0.6;            // largest distance from the plane, metres
const int PANE_STEPS = 4;

// Radiance at p from direction r, and 1 where a picture shows it, else 0. ``face`` is the normal of the pane at p.
vec4 in_pane(vec3 p, vec3 face, vec3 r, bool wanted) {
    int k = -1;
    float nearest = PANE_SAME;
    for (int i = 0; i < PANE_IMAGES; ++i) {
        float off = abs(dot(pane_planes[i].xyz, p) - pane_planes[i].w);
        bool mine = i < pane_count && off < nearest && dot(face, pane_planes[i].xyz) > 0.999;
        k = mine ? i : k;
        nearest = mine ? off : nearest;
    }
    wanted = wanted && k >= 0;
    int at = max(k, 0);
    mat3 rows = transpose(mat3(pane_rows[3 * at], pane_rows[3 * at + 1], pane_rows[3 * at + 2]));
    vec3 from = rows * (p - pane_eyes[at]), way = rows * r;
    vec2 size = pane_sizes[at], place = from.xy / from.z;
    // The picture shows what an even pane mirrors at its place in the pane. Where a bent pane shows it follows from its depth.
    int i = 0, steps = wanted ? PANE_STEPS : 1;
    do {
        ivec2 texel = clamp(ivec2((place * 0.5 + 0.5) * size), ivec2(0), ivec2(size) - 1);
        float depth = texelFetch(pane_images, ivec3(texel, at), 0).a;
        vec3 x = from + max(depth - from.z, 0.0) / max(way.z, 1e-3) * way;
        place = x.xy / x.z;
    } while (++i < steps);
    vec2 texel = (place * 0.5 + 0.5) * size;
    vec4 seen = textureLod(pane_images, vec3(clamp(texel, vec2(0.5), size - 0.5) / vec2(textureSize(pane_images, 0).xy), at), 0.0);
    bool known = wanted && all(greaterThan(texel, vec2(0.0))) && all(lessThan(texel, size)) && seen.a > 0.0;
    return vec4(seen.rgb, known ? 1.0 : 0.0);
}
