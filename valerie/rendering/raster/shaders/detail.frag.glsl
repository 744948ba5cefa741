// Depth that keeps samples of plain pixels from being lit one by one: nothing passes where it is 0.
uniform sampler2D plain_albedo;

void main() {
    gl_FragDepth = 1.0 - texelFetch(plain_albedo, ivec2(gl_FragCoord.xy) / 2, 0).a;
}
