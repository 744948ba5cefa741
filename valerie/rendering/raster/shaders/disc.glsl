// Points spread evenly over a disc, each turned from the previous one by the golden angle (Vogel 1979,
// doi:10.1016/0025-5564(79)90080-4). Rotating the previous direction costs one sine for all points.
const mat2 GOLDEN = mat2(-0.73736888, 0.67549029, -0.67549029, -0.73736888);
// Rotation by one radian.
const mat2 RADIAN = mat2(0.54030231, 0.84147098, -0.84147098, 0.54030231);

vec2 direction(float turn) {
    return vec2(cos(turn), sin(turn));
}
