// The background of the next drawing: sky, or a copy of the statics.
#ifdef FROM_STATICS
uniform usampler2D from_ids;
uniform sampler2D from_axis_depth;
uniform sampler2D from_depth;
#else
uniform uint sky_label;
uniform float nothing;
#endif
layout(location = 0) out uvec2 out_ids;
layout(location = 1) out float out_depth;

void main() {
#ifdef FROM_STATICS
    ivec2 s = ivec2(gl_FragCoord.xy);
    out_ids = texelFetch(from_ids, s, 0).rg;
    out_depth = texelFetch(from_axis_depth, s, 0).r;
    gl_FragDepth = texelFetch(from_depth, s, 0).r;
#else
    out_ids = uvec2(sky_label, 0u);
    out_depth = nothing;
    gl_FragDepth = 1.0;
#endif
}
