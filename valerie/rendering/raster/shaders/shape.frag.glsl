// Depth only: shadow maps, sky visibility.
#include "surface.glsl"

void main() {
#ifdef CLEAR
    see_through();
#endif
#ifdef CUT
    cut_by_alpha();
#endif
}
