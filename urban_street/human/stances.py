"""Stances: the rotations of all bones of a figure that walks, runs, stands, sits, reads its phone or holds something."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from urban_street.human import data
from urban_street.human.body import Body
from urban_street.human.pose import RUN, Gait, between, fingers, plant, pose_body, turn, walk
from urban_street.human.postures import HOLDING, LOW, Soles
from urban_street.human.surface import Points, normalize
from valerie.errors import UnknownName
from valerie.scene.graph.model import Stance

#: Poses of a figure, and those among them in which it walks or runs.
POSES: Final = ("walking", "standing", "phone", "waving", "running", *LOW, *HOLDING)
GAITS: Final = ("walking", "running", *(pose for pose in HOLDING if pose != "crutches"))
#: Things that a figure can carry. ``own`` is the character's own thing.
CARRIED: Final = ("own", "nothing", "shoulder-bag", "backpack", "shopping-bag", "umbrella")
#: The default stance of every figure: the instant shortly after a heel strike, with both feet on the ground.
DEFAULT: Final = Stance("walking", 0.0, "own")
#: Number of instants of the walk: a gait phase is rounded to the nearest instant.
GAIT_STEPS: Final = 16

#: Share of the cycle after each heel strike during which both feet carry weight.
_DOUBLE_SUPPORT: Final = 0.12
#: Distance between the ground and a swinging foot, metres.
_CLEARANCE: Final = 0.012

#: Poses that need the right hand.
_RIGHT_HANDED: Final = ("phone", "waving", *(pose for pose, hands in HOLDING.items() if hands.sides == "r"))
#: Things that a pose leaves no room for: a hand for it, or the place behind or beside a seated body.
_PUT_DOWN: Final[Mapping[str, tuple[str, ...]]] = {
    **{pose: ("umbrella", "shopping-bag") for pose, hands in HOLDING.items() if hands.sides != "r"},
    **dict.fromkeys(LOW, ("umbrella", "shopping-bag", "shoulder-bag")),
    "wheelchair": CARRIED[2:],
}

Direction = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class ArmReach:
    """The pose of the right arm, as directions seen from the trunk (x right, y ahead, z up). The left arm mirrors x.

    Attributes:
        upper, fore: directions of upper arm and forearm.
        hand: direction of the hand, from the wrist to the knuckles.
        palm: direction in which the palm faces.
        grip: curl of the fingers beyond the rest pose.
    """

    upper: Direction
    fore: Direction
    hand: Direction
    palm: Direction
    grip: float = 1.0


_PHONE: Final = ArmReach((0.16, 0.30, -1.0), (-0.42, 0.62, 0.62), (-0.40, 0.50, 0.77), (-0.10, -0.80, 0.60), 1.6)
_WAVE: Final = ArmReach((0.95, 0.10, -0.02), (0.22, 0.22, 1.0), (0.05, 0.10, 1.0), (-0.1, 1.0, 0.0), 0.25)
_CANOPY: Final = ArmReach((0.20, 0.22, -1.0), (-0.18, 0.80, 0.58), (-0.22, 0.95, 0.25), (-1.0, -0.1, 0.0), 3.0)
_LOAD: Final = ArmReach((0.20, 0.00, -1.0), (0.10, 0.10, -1.0), (0.02, 0.05, -1.0), (-1.0, 0.0, 0.0), 2.6)


def gait_step(phase: float) -> int:
    """Return the nearest instant, 0…`GAIT_STEPS` − 1, to a gait phase of 0…1."""
    return round(phase * GAIT_STEPS) % GAIT_STEPS


def rotations(body: Body, gait: Gait, pose: str, step: int, carries: str) -> dict[str, Rotation]:
    """Return the rotations of all bones.

    Args:
        gait: its gait, with the phase of the first instant.
        pose: one of `POSES`.
        step: number of instants after the first, see `GAIT_STEPS`.
        carries: the carried thing. It may change the pose of an arm.

    Raises:
        UnknownName: there is no such pose.
    """
    if pose not in POSES:
        raise UnknownName("pose", pose, POSES)
    gait = gait if step == 0 else replace(gait, phase=(gait.phase + step / GAIT_STEPS) % 1.0)
    if pose == "walking":
        turns = walk(body, gait)
    elif pose == "running":
        turns = walk(body, _running(gait), RUN)
        turns |= fingers(body, "l", 2.2) | fingers(body, "r", 2.2)
    elif pose in HOLDING and pose in GAITS:
        hands = HOLDING[pose]
        turns = walk(body, replace(gait, lean_deg=gait.lean_deg + hands.lean_deg, stride=gait.stride * hands.stride))
    else:
        turns = _stand(body, gait)
    if pose == "crutches":
        turns |= {"thigh_l": turn(x=12.0) * turns["thigh_l"], "calf_l": turn(x=-58.0), "foot_l": turn(x=-18.0)}
        turns |= {"spine_01": turn(x=-4.0), "spine_02": turn(x=-4.0), "head": turn(x=6.0)}
    if pose == "phone":
        turns |= _reach(body, _PHONE, "r")
        turns |= {"neck_01": turn(x=-14.0), "head": turn(x=-16.0, z=-3.0)}
    elif pose == "waving":
        turns |= _reach(body, _WAVE, "r")
        turns |= {"clavicle_r": turn(y=-12.0), "head": turn(z=-6.0)}
    if carries == "umbrella":
        turns |= _reach(body, _CANOPY, umbrella_side(pose))
    elif carries == "shopping-bag":
        turns |= _reach(body, _LOAD, "l")
    return turns


def feet_on_ground(
    body: Body, turns: Mapping[str, Rotation], gait: Gait, pose: str, step: int, soles: Soles
) -> dict[str, Rotation]:
    """Bring the feet that carry weight to the ground.

    The feet of a standing body become level. In a walk, both feet are planted while both carry weight. Otherwise the carrying
    foot is flat until its heel rises, and the other foot is lifted clear of the ground.

    Args:
        body, gait, pose, step: as for `rotations`, whose result is ``turns``.
        soles: see `Soles`.
    """
    if pose == "crutches":
        return _levelled(body, turns, "r", 1.0)
    if pose not in GAITS:
        return _levelled(body, _levelled(body, turns, "l", 1.0), "r", 1.0)
    phase = (gait.phase + step / GAIT_STEPS) % 1.0
    if pose == "running":
        flat = float(np.interp(phase % 0.5, [0.0, 0.06, 0.22, 0.32], [0.4, 1.0, 1.0, 0.0]))
        return _levelled(body, turns, "l" if phase < 0.5 else "r", flat)
    if phase % 0.5 < _DOUBLE_SUPPORT:
        return plant(body, turns, soles)
    carrying, free = ("l", "r") if phase < 0.5 else ("r", "l")
    flat = float(np.interp(phase % 0.5, [0.38, 0.48], [1.0, 0.0]))
    return _lifted(body, _levelled(body, turns, carrying, flat), carrying, free, soles)


def _levelled(body: Body, turns: Mapping[str, Rotation], side: str, share: float) -> dict[str, Rotation]:
    """Turn a foot by ``share`` of the way to a level sole, which is flat in the rest pose."""
    foot = data.rig().bones.index(f"foot_{side}")
    ahead = pose_body(body, turns).transforms[foot, :3, :3] @ np.array([0.0, 1.0, 0.0])
    pitch = np.degrees(np.arcsin(ahead[2]))
    return {**turns, f"foot_{side}": turns[f"foot_{side}"] * turn(x=-share * pitch)}


def _lifted(body: Body, turns: Mapping[str, Rotation], carrying: str, free: str, soles: Soles) -> dict[str, Rotation]:
    """Bend the free knee until its foot is clear of the ground under the carrying foot."""

    def height(rotations: Mapping[str, Rotation], side: str) -> float:
        return float(pose_body(body, rotations).apply(*soles[side])[:, 2].min())

    ground = height(turns, carrying)
    for degrees in range(0, 45, 3):
        bent = {**turns, f"calf_{free}": turns[f"calf_{free}"] * turn(x=-float(degrees))}
        if height(bent, free) > ground + _CLEARANCE:
            break
    return bent


def umbrella_side(pose: str) -> str:
    """Return the hand, ``l`` or ``r``, that holds an umbrella because the pose does not use it."""
    return "l" if pose in _RIGHT_HANDED else "r"


def kept(carries: str, pose: str) -> str:
    """Return the carried thing, or ``nothing`` if the pose leaves no hand or no room for it."""
    return "nothing" if carries in _PUT_DOWN.get(pose, ()) else carries


def _running(gait: Gait) -> Gait:
    """Return the gait of a run: bent elbows that swing further, and a lean."""
    return replace(
        gait, stride=0.4 + 0.6 * gait.stride, arm_swing_deg=34.0, elbow_deg=78.0, step_width_m=0.6 * gait.step_width_m,
        lean_deg=gait.lean_deg + 6.0,
    )  # fmt: skip


def _stand(body: Body, gait: Gait) -> dict[str, Rotation]:
    """Return the rotations of a body that stands upright on both legs, with its feet a hand apart."""
    still = replace(
        gait,
        phase=0.25,
        stride=0.0,
        arm_swing_deg=0.0,
        elbow_deg=14.0,
        step_width_m=gait.step_width_m + 0.09,
        lean_deg=1.0,
    )
    turns = walk(body, still)
    turns |= {f"ball_{side}": Rotation.identity() for side in "lr"}
    return turns


def _reach(body: Body, reach: ArmReach, side: str) -> Mapping[str, Rotation]:
    mirror = np.array([1.0 if side == "r" else -1.0, 1.0, 1.0])

    def towards(direction: Direction) -> Points:
        return normalize(mirror * np.array(direction))

    upper = normalize(body.tail(f"upperarm_{side}") - body.head(f"upperarm_{side}"))
    fore = normalize(body.tail(f"lowerarm_{side}") - body.head(f"lowerarm_{side}"))
    along, palm = hand_axes(body, side)
    shoulder = between(upper, towards(reach.upper))
    elbow = between(fore, shoulder.inv().apply(towards(reach.fore)))
    turn = _frame(towards(reach.hand), towards(reach.palm)) * _frame(along, palm).inv()
    # The forearm takes half of the wrist's twist, since its two bones turn about each other.
    wrist = (shoulder * elbow).inv() * turn
    half = Rotation.from_rotvec(0.5 * _twist(wrist, fore) * fore)
    elbow = elbow * half
    turns = {
        f"upperarm_{side}": shoulder,
        f"lowerarm_{side}": elbow,
        f"hand_{side}": (shoulder * elbow).inv() * turn,
    }
    return turns | fingers(body, side, reach.grip)


def hand_axes(body: Body, side: str) -> tuple[Points, Points]:
    """Return two perpendicular unit vectors in the rest pose: from wrist to knuckles, and out of the palm."""
    hand = body.head(f"hand_{side}")
    along = normalize(body.head(f"middle_01_{side}") - hand)
    palm = np.cross(along, body.head(f"index_01_{side}") - body.head(f"pinky_01_{side}"))
    if (body.tail(f"thumb_03_{side}") - hand) @ palm < 0.0:
        palm = -palm
    return along, normalize(palm - (palm @ along) * along)


def _frame(along: Points, palm: Points) -> Rotation:
    across = normalize(np.cross(along, palm))
    return Rotation.from_matrix(np.column_stack([along, np.cross(across, along), across]))


def _twist(rotation: Rotation, axis: Points) -> float:
    """Return the twist of a rotation about an axis, radians (swing–twist decomposition)."""
    x, y, z, w = rotation.as_quat()
    angle = 2.0 * np.arctan2(np.array([x, y, z]) @ axis, w)
    return float((angle + np.pi) % (2.0 * np.pi) - np.pi)
