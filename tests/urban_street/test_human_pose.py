"""Test body shape, gait and skinning."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from urban_street.human import data, pose
from urban_street.human.body import Body, BodyShape, shape_body
from urban_street.human.pose import Gait
from valerie.errors import InvalidInput


@pytest.fixture(scope="module")
def body() -> Body:
    return shape_body(BodyShape(sex=0.5))


def height(body: Body) -> float:
    rows = np.unique(data.base_mesh().groups["body"].quads)
    return float(np.ptp(body.vertices[rows, 2]))


def joint(body: Body, gait: Gait, bone: str) -> np.ndarray:
    posed = pose.pose_body(body, pose.walk(body, gait))
    index = data.rig().bones.index(bone)
    return posed.transforms[index, :3, :3] @ body.heads[index] + posed.transforms[index, :3, 3]


def test_the_height_slider_makes_taller() -> None:
    heights = [height(shape_body(BodyShape(sex=1.0, height=h))) for h in (0.2, 0.5, 0.8)]
    assert heights[0] < heights[1] - 0.05 < heights[2] - 0.1  # 5 cm each, a requirement of ours


def test_the_average_shape_mixes_man_and_woman() -> None:
    man, woman, both = (shape_body(BodyShape(sex=s)).vertices for s in (1.0, 0.0, 0.5))
    np.testing.assert_allclose(both, 0.5 * (man + woman), atol=1e-12)


@pytest.mark.parametrize("value", [-0.1, 1.1, float("nan")])
def test_a_slider_out_of_range_is_refused_by_name(value: float) -> None:
    with pytest.raises(InvalidInput, match="muscle"):
        BodyShape(sex=1.0, muscle=value)


def test_a_gait_phase_out_of_range_is_refused() -> None:
    with pytest.raises(InvalidInput, match="phase"):
        Gait(phase=1.5)


def test_the_rest_pose_leaves_every_vertex_in_place(body: Body) -> None:
    posed = pose.pose_body(body, {})
    np.testing.assert_allclose(posed.apply(body.vertices, data.rig().weights), body.vertices, atol=1e-12)


def test_turning_the_root_turns_the_body_rigidly(body: Body) -> None:
    turn = Rotation.from_euler("z", 90, degrees=True)
    posed = pose.pose_body(body, {"Root": turn}).apply(body.vertices, data.rig().weights)
    pivot = body.head("Root")
    np.testing.assert_allclose(posed, (body.vertices - pivot) @ turn.as_matrix().T + pivot, atol=1e-12)


def test_a_positive_hip_angle_brings_the_knee_forward(body: Body) -> None:
    posed = pose.pose_body(body, {"thigh_l": Rotation.from_euler("x", 30, degrees=True)})
    index = data.rig().bones.index("calf_l")
    knee = posed.transforms[index, :3, :3] @ body.heads[index] + posed.transforms[index, :3, 3]
    thigh = np.linalg.norm(body.head("calf_l") - body.head("thigh_l"))
    # By sin(30°) of the thigh when it hangs, and by sin(30° ± 6°) as far as it leans in the rest pose.
    assert knee[1] - body.head("calf_l")[1] > np.sin(np.deg2rad(24.0)) * thigh


def test_the_striking_leg_is_ahead_and_its_arm_behind(body: Body) -> None:
    gait = Gait(phase=0.0)
    # Requirements of ours, in metres: a step of half a leg's length, and arms that swing by a third of that.
    assert joint(body, gait, "foot_l")[1] > joint(body, gait, "foot_r")[1] + 0.4
    assert joint(body, gait, "hand_l")[1] < joint(body, gait, "hand_r")[1] - 0.15


def test_half_a_cycle_later_left_and_right_have_changed_roles(body: Body) -> None:
    now, later = Gait(phase=0.1), Gait(phase=0.6)
    for bone in ("foot", "calf", "lowerarm"):
        a, b = joint(body, now, f"{bone}_l"), joint(body, later, f"{bone}_r")
        np.testing.assert_allclose(a * [-1.0, 1.0, 1.0], b, atol=0.01)


def test_the_gait_is_periodic(body: Body) -> None:
    np.testing.assert_allclose(
        joint(body, Gait(phase=0.0), "ball_r"), joint(body, Gait(phase=1.0), "ball_r"), atol=1e-12
    )


def test_the_swing_leg_clears_the_ground(body: Body) -> None:
    # At 0.75 of its cycle the left leg swings through while the right one carries. 5 cm are a requirement of ours.
    gait = Gait(phase=0.75)
    assert joint(body, gait, "foot_l")[2] > joint(body, gait, "foot_r")[2] + 0.05


def test_arms_hang_beside_the_body(body: Body) -> None:
    for side, sign in (("l", -1.0), ("r", 1.0)):
        hand, shoulder = (joint(body, Gait(phase=0.25), f"{bone}_{side}") for bone in ("hand", "upperarm"))
        # An arm is 0.5 m long or more, to the wrist. Shoulders are 0.4 m wide, and an arm hangs within 0.25 m of them.
        assert hand[2] < shoulder[2] - 0.4
        assert 0.15 < sign * hand[0] < 0.45


def test_planting_brings_both_soles_to_one_height(body: Body) -> None:
    rig, rows = data.rig(), np.unique(data.base_mesh().groups["body"].quads)
    soles = {}
    for side in ("l", "r"):
        of_foot = rig.weights[rows][:, [rig.bones.index(f"{b}_{side}") for b in ("foot", "ball")]].sum(axis=1) > 0.9
        soles[side] = (body.vertices[rows[of_foot]], rig.weights[rows[of_foot]])
    before = pose.walk(body, Gait(phase=0.06, stride=0.85))
    after = pose.plant(body, before, soles)

    def gap(rotations: dict[str, Rotation]) -> float:
        posed = pose.pose_body(body, rotations)
        left, right = (float(posed.apply(*soles[s])[:, 2].min()) for s in ("l", "r"))
        return abs(left - right)

    # The stride would leave a foot a centimetre or more in the air; planted, both are level to a tenth of a millimetre.
    assert gap(before) > 0.01
    assert gap(after) < 1e-4


def test_planting_leaves_a_leg_in_swing_alone(body: Body) -> None:
    weights = np.zeros((1, len(data.rig().bones)))
    soles = {}
    for side in ("l", "r"):
        own = weights.copy()
        own[0, data.rig().bones.index(f"foot_{side}")] = 1.0
        soles[side] = (body.head(f"foot_{side}")[None], own)
    before = pose.walk(body, Gait(phase=0.72))
    after = pose.plant(body, before, soles)
    assert all(np.array_equal(before[b].as_matrix(), after[b].as_matrix()) for b in before)
