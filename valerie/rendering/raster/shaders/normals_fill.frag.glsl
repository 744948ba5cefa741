// The background of the next drawing: nothing, or a copy of the statics.
#ifdef FROM_STATICS
uniform isampler2D from_normals;
uniform sampler2D from_depth;
#endif
layout(location = 0) out ivec2 out_normal;

void main() {
#ifdef FROM_STATICS
    ivec2 s = ivec2(gl_FragCoord.xy);
    out_normal = texelFetch(from_normals, s, 0).rg;
    gl_FragDepth = texelFetch(from_depth, s, 0).r;
#else
    out_normal = ivec2(-32768);
    gl_FragDepth = 1.0;
#endif
}
