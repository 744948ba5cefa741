"""Postures besides walking and standing: low or seated bodies, and hands that hold what their owner leans on or pushes.

Places are in the figure's frame: its origin is on the ground below the hip joints, x to the right, y ahead, z up. They are in
metres for things of a fixed size, and in the body's leg lengths (from hip joint to sole) for all others.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final, Literal

import numpy as np
from scipy.spatial.transform import Rotation

from urban_street.human import data
from urban_street.human.body import Body
from urban_street.human.pose import fingers, pose_body, turn
from urban_street.human.reaching import HANDLEBAR, Hold, arm, leg, moved
from urban_street.human.surface import Points

Place = tuple[float, float, float]
#: Side ``l`` or ``r`` to (V, 3) rest points of the sole and their (V, bones) weights.
Soles = Mapping[str, tuple[Points, Points]]


@dataclass(frozen=True, slots=True)
class Hand:
    """The goal of the right hand; the left one mirrors x.

    Attributes:
        place: middle of the palm's grip.
        hold: directions of hand and elbow.
        curl: curl of the fingers, see `pose.fingers`.
        on: what the place is relative to: the ``ground`` below the hips, or the ``knee`` of its side.
    """

    place: Place
    hold: Hold = HANDLEBAR
    curl: float = 2.7
    on: Literal["ground", "knee"] = "ground"


@dataclass(frozen=True, slots=True)
class Hands:
    """The goals of both hands, each None if it swings or hangs freely.

    Attributes:
        metres: True if the places are metres instead of leg lengths.
        lean_deg: additional lean of the trunk.
        stride: factor of the steps.
    """

    right: Hand | None
    left: Hand | None
    metres: bool = False
    lean_deg: float = 0.0
    stride: float = 1.0

    @property
    def sides(self) -> str:
        """Return the sides of the hands that are busy: ``r``, ``l`` or both."""
        return "".join(side for side, hand in (("r", self.right), ("l", self.left)) if hand is not None)


@dataclass(frozen=True, slots=True)
class Foot:
    """The goal of the right foot; the left one mirrors x.

    Attributes:
        x, y: place of the ankle; without y, the shin lies behind a knee on the ground.
        heel_deg: rise of the heel over the ball, on which the toes stay flat.
    """

    x: float
    y: float | None
    heel_deg: float = 0.0


@dataclass(frozen=True, slots=True)
class Low:
    """A low posture.

    Attributes:
        hips: height of the hip joints, leg lengths; None for a body that sits or kneels.
        seat: height of the surface under a body that sits, metres; 0 for the ground.
        rest: height of the surface under the feet, metres.
        right, left: goals of the feet, in metres if ``metres``.
        hands: goals of the hands.
        lean_deg: forward lean of the trunk.
        knees_out: outward turn of the knees, 0 … 1.
    """

    right: Foot
    left: Foot
    hands: Hands
    lean_deg: float
    hips: float | None = None
    seat: float = 0.0
    rest: float = 0.0
    metres: bool = False
    knees_out: float = 0.2


_ON_KNEE: Final = Hold((-0.30, 1.0, -0.55), (-0.1, -0.45, -1.0), (1.0, -0.5, -0.5))
_DOWN: Final = Hold((0.05, 0.25, -1.0), (-1.0, 0.0, 0.0), (0.6, -1.0, 0.0))
_STICK: Final = Hold((-0.10, 0.92, -0.38), (-0.45, -0.25, -0.85), (0.55, -1.0, -0.2))
_RIM: Final = Hold((-0.05, 0.85, -0.52), (-0.85, -0.2, -0.5), (1.0, -0.9, 0.1))
_SIDES: Final = Hold((-0.25, 0.95, -0.15), (-1.0, -0.1, 0.25), (0.8, -0.3, -1.0))
_PUSH: Final = Hold((-0.25, 0.95, -0.20), (-0.20, -0.25, -0.95), (0.7, -0.6, -0.9))
_LEASH: Final = Hold((-0.15, 0.85, -0.50), (-0.9, 0.0, -0.4), (0.5, -1.0, -0.4))

#: Poses in which the legs walk (with `stances.GAITS`) or stand and the hands hold something.
HOLDING: Final[Mapping[str, Hands]] = MappingProxyType(
    {
        "stroller": Hands(
            Hand((0.16, 0.44, 1.02), _PUSH), Hand((0.16, 0.44, 1.02), _PUSH), metres=True, lean_deg=4.0, stride=0.85
        ),
        "bicycle": Hands(
            Hand((0.44, 0.00, 0.950), _STICK, 1.4), Hand((-0.165, 0.44, 1.070), _PUSH), metres=True, stride=0.85
        ),
        "crutches": Hands(Hand((0.36, 0.16, 0.86), _STICK), Hand((0.36, 0.16, 0.86), _STICK), lean_deg=7.0),
        "walking-frame": Hands(
            Hand((0.25, 0.30, 0.90), HANDLEBAR), Hand((0.25, 0.30, 0.90), HANDLEBAR), metres=True, lean_deg=9.0, stride=0.6
        ),
        "cane": Hands(Hand((0.31, 0.22, 0.93), _STICK), None, lean_deg=4.0, stride=0.7),
        "box": Hands(Hand((0.26, 0.36, 1.12), _SIDES, 1.2), Hand((0.26, 0.36, 1.12), _SIDES, 1.2), lean_deg=-5.0, stride=0.8),
        "dog": Hands(Hand((0.32, 0.30, 1.02), _LEASH), None, stride=0.9),
    }
)  # fmt: skip
#: Thickness of the clothes under a body that sits or kneels, metres.
_CLOTH_M: Final = 0.012
#: Height of a knee's joint that lies on the ground, metres.
_KNEE_M: Final = 0.068
#: Height of the seat and of the footrest of a wheelchair, metres.
SEAT_M, FOOTREST_M = 0.50, 0.13
_KNEES: Final = Hand((0.0, -0.02, 0.085), _ON_KNEE, 1.0, "knee")
#: Poses with low or seated bodies.
LOW: Final[Mapping[str, Low]] = MappingProxyType(
    {
        "sitting": Low(Foot(0.13, 0.52), Foot(0.15, 0.60), Hands(_KNEES, _KNEES), 12.0, knees_out=0.30),
        "kneeling": Low(
            Foot(0.10, None, 62.0), Foot(0.13, 0.46),
            Hands(Hand((0.30, 0.18, 0.42), _DOWN, 1.3), Hand((0.0, -0.02, 0.085), _ON_KNEE, 1.0, "knee")),
            16.0, knees_out=0.10,
        ),
        "crouching": Low(
            Foot(0.20, 0.10, 18.0), Foot(0.18, 0.16, 12.0),
            Hands(Hand((-0.13, 0.16, 0.02), _ON_KNEE, 1.3, "knee"), Hand((-0.13, 0.16, 0.02), _ON_KNEE, 1.3, "knee")),
            34.0, hips=0.36, knees_out=0.45,
        ),
        "wheelchair": Low(
            Foot(0.10, 0.50), Foot(0.10, 0.50),
            Hands(Hand((0.285, 0.06, 0.625), _RIM, 1.7), Hand((0.285, 0.10, 0.615), _RIM, 1.7), metres=True),
            2.0, seat=SEAT_M, rest=FOOTREST_M, metres=True, knees_out=0.06,
        ),
    }
)  # fmt: skip


def leg_length(body: Body, soles: Soles) -> float:
    """Return the distance from the hip joints down to the soles of the rest pose, metres."""
    lowest = min(float(points[:, 2].min()) for points, _ in soles.values())
    return float(body.head("thigh_l")[2]) - lowest


def hips(transforms: Points, body: Body) -> Points:
    """Return the middle of the posed hip joints, (3,)."""
    return np.asarray(np.mean([moved(transforms, "pelvis", body.head(f"thigh_{side}")) for side in "lr"], axis=0))


def take(body: Body, low: Low, soles: Soles) -> tuple[dict[str, Rotation], Points]:
    """Return the rotations of a body in a low posture, and the origin of the figure's frame in the body's, (3,)."""
    lean = low.lean_deg
    turns = {
        "pelvis": turn(x=-0.45 * lean),
        "spine_01": turn(x=-0.25 * lean),
        "spine_02": turn(x=-0.20 * lean),
        "spine_03": turn(x=-0.10 * lean),
        "neck_01": turn(x=0.40 * lean),
        "head": turn(x=0.45 * lean - 3.0),
    }
    if low.hips is not None:
        return _seated(body, low, soles, turns, low.hips * leg_length(body, soles))
    if low.right.y is None:
        return _seated(body, low, soles, turns, _length(body, "thigh_r", "calf_r") + _KNEE_M)
    # The flesh under a body that sits has a height of its own: first guess it, then measure it.
    height = low.seat + 0.1
    for _ in range(2):
        height = low.seat + _flesh(body, _seated(body, low, soles, turns, height)[0])
    return _seated(body, low, soles, turns, height)


def _length(body: Body, first: str, second: str) -> float:
    """Return the distance between the joints where two bones begin, metres."""
    return float(np.linalg.norm(body.head(second) - body.head(first)))


def _flesh(body: Body, turns: Mapping[str, Rotation]) -> float:
    """Return the height of the hip joints over the lowest skin of seat and thighs, metres."""
    posed, rig = pose_body(body, turns), data.rig()
    rows = np.unique(data.base_mesh().groups["body"].quads)
    bones = [rig.bones.index(name) for name in ("pelvis", "thigh_l", "thigh_r")]
    near = rows[rig.weights[rows][:, bones].sum(axis=1) > 0.6]
    lowest = posed.apply(body.vertices[near], rig.weights[near])[:, 2].min()
    return float(hips(posed.transforms, body)[2] - lowest) + _CLOTH_M


def _seated(
    body: Body, low: Low, soles: Soles, trunk: Mapping[str, Rotation], height: float
) -> tuple[dict[str, Rotation], Points]:
    """Return the rotations of a body whose hip joints are at a height, metres, and its origin."""
    turns = dict(trunk)
    transforms = pose_body(body, turns).transforms
    origin = hips(transforms, body) - [0.0, 0.0, height]
    unit = 1.0 if low.metres else leg_length(body, soles)
    pelvis = transforms[data.rig().bones.index("pelvis")][:3, :3]
    for side, outwards, foot in (("r", 1.0, low.right), ("l", -1.0, low.left)):
        tilt, toes = turn(x=-foot.heel_deg), turn(x=foot.heel_deg)
        flat = pose_body(body, {f"foot_{side}": tilt, f"ball_{side}": toes}).apply(*soles[side])
        rise = float(body.head(f"foot_{side}")[2] - flat[:, 2].min())
        shin = _length(body, "calf_r", "foot_r")
        y = -float(np.sqrt(shin**2 - (rise - _KNEE_M) ** 2)) if foot.y is None else foot.y * unit
        goal = origin + np.array([outwards * foot.x * unit, y, low.rest + rise])
        hip = moved(transforms, "pelvis", body.head(f"thigh_{side}"))
        pole = np.array([outwards * low.knees_out, 1.0, 0.6] if foot.y is not None else [0.0, 0.5, -1.0])
        turns |= leg(body, side, pelvis, hip, goal, tilt.as_matrix(), pole) | {f"ball_{side}": toes}
    return turns | reach(body, turns, low.hands, origin, leg_length(body, soles)), origin


def reach(
    body: Body, turns: Mapping[str, Rotation], hands: Hands, origin: Points, length: float
) -> dict[str, Rotation]:
    """Return the rotations of the arms whose hands hold something.

    Args:
        turns: rotations of all other bones.
        origin: (3,) origin of the figure's frame.
        length: leg length of the body, metres.
    """
    transforms = pose_body(body, turns).transforms
    arms: dict[str, Rotation] = {}
    for side, outwards, hand in (("r", 1.0, hands.right), ("l", -1.0, hands.left)):
        if hand is None:
            continue
        base = moved(transforms, f"calf_{side}", body.head(f"calf_{side}")) if hand.on == "knee" else origin
        unit = 1.0 if hands.metres else length
        grip = base + unit * np.asarray(hand.place) * [outwards, 1.0, 1.0]
        clavicle = transforms[data.rig().bones.index(f"clavicle_{side}")][:3, :3]
        shoulder = moved(transforms, f"clavicle_{side}", body.head(f"upperarm_{side}"))
        arms |= arm(body, side, clavicle, shoulder, grip, hand.hold) | fingers(body, side, hand.curl)
    return arms
