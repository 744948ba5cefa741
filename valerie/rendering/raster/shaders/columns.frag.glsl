// Height of the surfaces over each place, with its sign turned and as it is: the largest values are the lowest and the highest.
#include "surface.glsl"
layout(location = 0) out vec2 out_heights;

void main() {
#ifdef CUT
    cut_by_alpha();
#endif
    out_heights = vec2(-world_position.z, world_position.z);
}
