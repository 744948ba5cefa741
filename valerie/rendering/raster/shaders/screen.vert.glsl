// Corners of the parts of a target that a pass runs over, in clip space. Nothing is interpolated: fragments use gl_FragCoord.
in vec2 corner;

void main() {
    gl_Position = vec4(corner, 0.0, 1.0);
}
