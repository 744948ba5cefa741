// Depth that masks the samples of plain pixels: nothing passes the depth test where it is 0.
uniform sampler2D plain_albedo;

void main() {
    gl_FragDepth = 1.0 - texelFetch(plain_albedo, ivec2(gl_FragCoord.xy) / 2, 0).a;
}
