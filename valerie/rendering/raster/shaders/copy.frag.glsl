// Copies the G-buffer of the statics into the one on which movables are drawn.
uniform sampler2D from_albedo;
uniform sampler2D from_normals;
uniform usampler2D from_material;
uniform sampler2D from_depth;
layout(location = 0) out vec4 out_albedo;
layout(location = 1) out vec4 out_normals;
layout(location = 2) out uvec2 out_material;

void main() {
    ivec2 s = ivec2(gl_FragCoord.xy);
    out_albedo = texelFetch(from_albedo, s, 0);
    out_normals = texelFetch(from_normals, s, 0);
    out_material = texelFetch(from_material, s, 0).rg;
    gl_FragDepth = texelFetch(from_depth, s, 0).r;
}
