// Surface normal in the world, one point sample per pixel centre, aligned with the truth pass.
#include "octahedron.glsl"
#include "surface.glsl"
layout(location = 0) out ivec2 out_normal;

void main() {
#ifdef CUT
    cut_by_alpha();
#endif
    vec3 normal = normalize(world_normal);
    if (!gl_FrontFacing) normal = -normal;
    out_normal = ivec2(round((octahedron_encode(normal) * 2.0 - 1.0) * 32767.0));
}
