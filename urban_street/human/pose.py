"""Poses: joint rotations in anatomical terms, a walking gait, and linear blend skinning.

Rotations are about the *world* axes of the rest pose (x to the character's right, y forward, z up), so bone roll has no effect.
A positive turn about x swings a hanging limb forward.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from urban_street.human import data
from urban_street.human.body import Body
from urban_street.human.surface import Points, normalize
from valerie.errors import InvalidInput
from valerie.scene.graph.model import JOINTS

# Sagittal joint angles of level walking, degrees, over the gait cycle, percent (0 is heel strike). They have the shape of
# measured curves (two peaks of the knee, push-off of the ankle), but were set by eye and not taken from a study.
_HIP: Final = {0: 28, 10: 24, 20: 15, 30: 6, 40: -4, 50: -11, 60: -5, 70: 12, 80: 25, 90: 30}
_KNEE: Final = {0: 4, 7: 12, 15: 18, 25: 14, 38: 5, 50: 12, 60: 36, 71: 60, 80: 47, 90: 17, 96: 4}
_ANKLE: Final = {0: 0, 7: -6, 20: 4, 35: 8, 46: 10, 54: 0, 62: -17, 72: -6, 82: 1, 92: 1}
_TOES: Final = {0: 8, 8: 0, 30: 0, 45: 8, 55: 26, 62: 20, 70: 5, 85: 8}


class Curves(NamedTuple):
    """Sagittal angles of the legs, degrees, over the gait cycle, percent: flexion of hip, knee, ankle; rise of the toes."""

    hip: Mapping[int, float]
    knee: Mapping[int, float]
    ankle: Mapping[int, float]
    toes: Mapping[int, float]


WALK: Final = Curves(_HIP, _KNEE, _ANKLE, _TOES)
#: Of running at an easy pace, set by eye, too: the knee gives at each step and folds while the leg swings.
RUN: Final = Curves(
    hip={0: 34, 15: 18, 28: -4, 38: -14, 48: -8, 62: 26, 78: 54, 90: 46},
    knee={0: 16, 14: 36, 26: 26, 38: 16, 50: 62, 64: 104, 78: 82, 91: 32},
    ankle={0: 4, 14: 18, 26: 6, 38: -24, 48: -18, 66: 0, 88: 4},
    toes={0: 4, 14: 0, 24: 8, 36: 28, 46: 12, 62: 2, 85: 4},
)

#: Joint to the bone that begins at it; without the side for limbs.
_BONES: Final = {
    "pelvis": "pelvis", "spine": "spine_02", "chest": "spine_03", "neck": "neck_01", "head": "head", "shoulder": "upperarm",
    "elbow": "lowerarm", "wrist": "hand", "hip": "thigh", "knee": "calf", "ankle": "foot", "toes": "ball",
}  # fmt: skip

#: Largest difference in height of the soles of two feet on the ground, metres.
_DOUBLE_SUPPORT: Final = 0.08


@dataclass(frozen=True, slots=True)
class Gait:
    """One instant of a walk.

    Attributes:
        phase: phase of the left leg: 0 is its heel strike, 1 the next one.
        stride: factor of the sagittal angles of the legs; 1 for natural cadence.
        arm_swing_deg: amplitude of the shoulders.
        elbow_deg: mean flexion of the elbows.
        arm_out_deg: angle of the upper arms away from the body.
        step_width_m: lateral distance between the ankles.
        lean_deg: forward lean of the trunk.
    """

    phase: float
    stride: float = 1.0
    arm_swing_deg: float = 18.0
    elbow_deg: float = 24.0
    arm_out_deg: float = 12.0
    step_width_m: float = 0.11
    lean_deg: float = 3.0

    def __post_init__(self) -> None:
        if not 0.0 <= self.phase <= 1.0:
            raise InvalidInput("gait phase out of range", field="phase", value=self.phase, limit="0…1")


@dataclass(frozen=True, slots=True, eq=False)
class Posed:
    """The poses of all bones.

    Attributes:
        transforms: (bones, 4, 4) float64, rest to posed.
    """

    transforms: NDArray[np.float64]

    def apply(self, points: Points, weights: Points) -> Points:
        """Apply linear blend skinning to (V, 3) rest points with (V, bones) weights."""
        blended = np.einsum("vb,bij->vij", weights, self.transforms[:, :3, :], optimize=True)
        places: Points = np.einsum("vij,vj->vi", blended[:, :, :3], points) + blended[:, :, 3]
        return places


def joints(body: Body, posed: Posed) -> Points:
    """Return the joints of a posed body in its frame, (len(JOINTS), 3)."""
    bones = data.rig().bones
    places = []
    for name in JOINTS:
        bone, place = _joint(body, name)
        transform = posed.transforms[bones.index(bone)]
        places.append(transform[:3, :3] @ place + transform[:3, 3])
    return np.array(places)


def _joint(body: Body, name: str) -> tuple[str, Points]:
    """Return the bone of a joint, and the joint's place in the rest pose."""
    if name == "head_top":
        return "head", body.tail("head")
    side, _, part = name.rpartition("_")
    if part == "eye":
        group = data.base_mesh().groups[f"helper-{side[0]}-eye"]
        return "head", body.vertices[np.unique(group.quads)].mean(axis=0)
    bone = _BONES[part] + (f"_{side[0]}" if side else "")
    return bone, body.head(bone)


def pose_body(body: Body, rotations: Mapping[str, Rotation]) -> Posed:
    """Return the posed bones. Each rotation turns its bone, and all below it, about the bone's joint."""
    rig = data.rig()
    transforms = np.zeros((len(rig.bones), 4, 4))
    for index, (bone, parent) in enumerate(zip(rig.bones, rig.parents, strict=True)):
        local = np.eye(4)
        if bone in rotations:
            turn = rotations[bone].as_matrix()
            local[:3, :3] = turn
            local[:3, 3] = body.heads[index] - turn @ body.heads[index]
        transforms[index] = local if parent < 0 else transforms[parent] @ local
    return Posed(transforms)


def walk(body: Body, gait: Gait, curves: Curves = WALK) -> dict[str, Rotation]:
    """Return the rotations of all bones at one instant of a walk, or of a run."""
    twist = 5.0 * np.cos(2.0 * np.pi * gait.phase)  # the pelvis turns forward with the striking leg
    rotations = {
        "pelvis": turn(z=-twist),
        "spine_01": turn(x=-0.4 * gait.lean_deg, z=0.8 * twist),
        "spine_02": turn(x=-0.4 * gait.lean_deg, z=0.8 * twist),
        "spine_03": turn(x=-0.2 * gait.lean_deg, z=0.4 * twist),
        "neck_01": turn(x=0.5 * gait.lean_deg, z=-0.6 * twist),
        "head": turn(x=0.5 * gait.lean_deg + 3.0, z=-0.4 * twist),
    }
    for side, offset in (("l", 0.0), ("r", 0.5)):
        rotations |= _leg(body, gait, curves, side, gait.phase + offset, twist)
        rotations |= _arm(body, gait, side, gait.phase + offset)
        rotations |= fingers(body, side)
    return rotations


def _leg(body: Body, gait: Gait, curves: Curves, side: str, phase: float, twist: float) -> dict[str, Rotation]:
    outwards = -1.0 if side == "l" else 1.0
    hip, ankle = body.head(f"thigh_{side}"), body.head(f"foot_{side}")
    current, target = ankle - hip, np.array([outwards * gait.step_width_m / 2.0, 0.0, 0.0]) - hip
    inwards = np.degrees(np.arctan2(current[0], -current[2]) - np.arctan2(target[0], -current[2]))
    # Turn the leg back against the pelvis, so that the feet point ahead.
    splay = 0.6 * (body.tail(f"foot_{side}") - ankle)[:2]
    toes_in = np.degrees(np.arctan2(splay[0], splay[1])) * 0.45
    level = turn(y=-inwards)
    thigh = turn(z=twist + toes_in) * turn(x=gait.stride * _curve(curves.hip, phase)) * turn(y=inwards)
    return {
        f"thigh_{side}": thigh,
        f"calf_{side}": turn(x=-gait.stride * _curve(curves.knee, phase)),
        f"foot_{side}": level * turn(x=gait.stride * _curve(curves.ankle, phase)),
        f"ball_{side}": turn(x=_curve(curves.toes, phase)),
    }


def _arm(body: Body, gait: Gait, side: str, phase: float) -> dict[str, Rotation]:
    outwards = -1.0 if side == "l" else 1.0
    upper = normalize(body.tail(f"upperarm_{side}") - body.head(f"upperarm_{side}"))
    fore = normalize(body.tail(f"lowerarm_{side}") - body.head(f"lowerarm_{side}"))
    out = np.radians(gait.arm_out_deg)
    hanging = np.array([outwards * np.sin(out), 0.0, -np.cos(out)])
    # An arm swings opposite to the leg of its side: it is furthest back at that leg's heel strike.
    swing = -np.cos(2.0 * np.pi * phase)
    lower = between(upper, hanging)
    flexion_axis = normalize(np.cross(upper, [0.0, 1.0, 0.0]))
    straighten = between(fore, upper)
    bend = Rotation.from_rotvec(np.radians(gait.elbow_deg + 0.6 * gait.arm_swing_deg * swing) * flexion_axis)
    roll = Rotation.from_rotvec(np.radians(outwards * -12.0) * upper)
    return {
        f"clavicle_{side}": turn(y=outwards * 4.0, z=outwards * 4.0 * swing),
        f"upperarm_{side}": turn(x=gait.arm_swing_deg * swing + 2.0) * lower,
        f"lowerarm_{side}": bend * roll * straighten,
        f"hand_{side}": Rotation.from_rotvec(np.radians(outwards * -22.0) * fore),
    }


def fingers(body: Body, side: str, grip: float = 1.0) -> dict[str, Rotation]:
    """Return the rotations of fingers curled towards the palm, the little finger most; ``grip`` 1 is relaxed, 3 a fist."""
    hand = body.head(f"hand_{side}")
    across = body.head(f"index_01_{side}") - body.head(f"pinky_01_{side}")
    along = body.head(f"middle_01_{side}") - hand
    palm = normalize(np.cross(along, across))
    thumb = body.tail(f"thumb_03_{side}") - hand
    if thumb @ palm < 0.0:  # the thumb lies on the palm's side
        palm = -palm
    turns = {}
    for finger, curl in (("index", 16.0), ("middle", 21.0), ("ring", 26.0), ("pinky", 30.0)):
        for joint, factor in (("01", 1.0), ("02", 1.35), ("03", 0.9)):
            bone = f"{finger}_{joint}_{side}"
            axis = normalize(np.cross(body.tail(bone) - body.head(bone), palm))
            turns[bone] = Rotation.from_rotvec(np.radians(min(curl * factor * grip, 75.0)) * axis)
    towards = normalize(body.head(f"middle_02_{side}") - body.tail(f"thumb_02_{side}"))
    for joint, angle in (("01", 14.0), ("02", 10.0), ("03", 14.0)):
        bone = f"thumb_{joint}_{side}"
        axis = normalize(np.cross(body.tail(bone) - body.head(bone), towards))
        turns[bone] = Rotation.from_rotvec(np.radians(angle) * axis)
    return turns


def _curve(knots: Mapping[int, float], phase: float) -> float:
    """Return the value at ``phase`` of the periodic cubic spline through knots in percent of the cycle."""
    places = [*(percent / 100.0 for percent in knots), 1.0]
    values = [*knots.values(), next(iter(knots.values()))]
    return float(CubicSpline(places, values, bc_type="periodic")(phase % 1.0))


def turn(*, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Rotation:
    """Return the rotation by degrees about one or more fixed world axes, x first."""
    return Rotation.from_euler("xyz", [x, y, z], degrees=True)


def between(start: Points, end: Points) -> Rotation:
    """Return the shortest rotation that turns one unit vector into another."""
    axis = np.cross(start, end)
    length = float(np.linalg.norm(axis))
    if length < 1e-9:
        return Rotation.identity()
    return Rotation.from_rotvec(axis / length * np.arctan2(length, float(start @ end)))


def plant(
    body: Body, rotations: Mapping[str, Rotation], soles: Mapping[str, tuple[Points, Points]]
) -> dict[str, Rotation]:
    """Bring both feet to the ground if the gait has both on it.

    The joint angles leave a gap of centimetres under one foot. The knee of the leg that reaches lower bends until both soles
    touch the same plane. Feet further apart (a leg in swing) are left as they are.

    Args:
        soles: side to (V, 3) rest points of the sole and their (V, bones) weights.
    """

    def lowest(knees: Mapping[str, Rotation], side: str) -> float:
        posed = pose_body(body, knees)
        return float(posed.apply(*soles[side])[:, 2].min())

    heights = {side: lowest(rotations, side) for side in soles}
    longer = min(heights, key=lambda side: heights[side])
    gap = max(heights.values()) - heights[longer]
    if gap > _DOUBLE_SUPPORT:
        return dict(rotations)
    bone = f"calf_{longer}"

    def bent(degrees: float) -> dict[str, Rotation]:
        return {**rotations, bone: rotations[bone] * turn(x=-degrees)}

    low, high = 0.0, 40.0
    for _ in range(24):
        middle = 0.5 * (low + high)
        if lowest(bent(middle), longer) - heights[longer] < gap:
            low = middle
        else:
            high = middle
    return bent(0.5 * (low + high))
