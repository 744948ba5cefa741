// Optical flow of the surface point at a pixel centre: its position in the image at another moment, pixels from the left and the
// top; its present depth along the optical axis; and its label and instance, negative if the object is absent then or the point
// is not in front of the camera.
#include "surface.glsl"
in vec3 elsewhere;
uniform mat4 clip_from_elsewhere;
uniform vec2 image_size;
uniform bool is_elsewhere;
layout(location = 0) out vec4 out_flow;

void main() {
#ifdef CUT
    cut_by_alpha();
#endif
    vec4 clip = clip_from_elsewhere * vec4(elsewhere, 1.0);
    bool known = is_elsewhere && clip.w > 0.0;
    vec2 pixel = known ? (0.5 + vec2(0.5, -0.5) * clip.xy / clip.w) * image_size : vec2(0.0);
    // Both ids are exact in a float: at most 33 · 65536 + 65535.
    float ids = float(label * 65536u + instance);
    out_flow = vec4(pixel, axis_depth, known ? ids : -ids);
}
