// Places of a disc, spread evenly: the golden angle from one to the next (Vogel 1979, doi:10.1016/0025-5564(79)90080-4). A CPU
// computes one sine for all of them by turning the last direction on.
const mat2 GOLDEN = mat2(-0.73736888, 0.67549029, -0.67549029, -0.73736888);
// A turn by one radian.
const mat2 RADIAN = mat2(0.54030231, 0.84147098, -0.84147098, 0.54030231);

vec2 direction(float turn) {
    return vec2(cos(turn), sin(turn));
}
