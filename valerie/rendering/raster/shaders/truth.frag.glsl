// Labels and depth along the optical axis, one point sample per pixel centre.
#include "surface.glsl"
layout(location = 0) out uvec2 out_ids;
layout(location = 1) out float out_depth;

void main() {
#ifdef CUT
    cut_by_alpha();
#endif
    out_ids = uvec2(label, instance);
    out_depth = axis_depth;
}
