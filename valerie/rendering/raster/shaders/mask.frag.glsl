// Writes 1 to every pixel that an object covers when it is rendered alone.
#include "surface.glsl"
layout(location = 0) out float out_mask;

void main() {
#ifdef CUT
    cut_by_alpha();
#endif
    out_mask = 1.0;
}
