"""Sitting on a bicycle or motorcycle: hands on the grips, feet on the pedals, by two-bone inverse kinematics."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from urban_street.human import data
from urban_street.human.body import Body
from urban_street.human.pose import fingers, pose_body, turn
from urban_street.human.reaching import arm, leg, moved
from urban_street.human.surface import Points

Place = tuple[float, float, float]

#: Offset of the hip joints above the saddle's surface, and forward, metres.
_SEAT_TO_HIPS = (0.035, 0.085)
#: Height of the ball of the foot above the pedal, metres: the shoe's sole and the foot.
_SOLE = 0.030


@dataclass(frozen=True, slots=True)
class Contact:
    """The places of a rider's seat, grips and feet; metres in the vehicle's frame (facing +y, z up).

    Attributes:
        seat: top of the saddle under the sit bones.
        grip: middle of the right grip. The left one is its mirror image.
        foot: places under the ball of the right and of the left foot.
        lean_deg: forward lean of the trunk.
        knees_out: outward turn of the knees, 0 … 1.
    """

    seat: Place
    grip: Place
    foot: tuple[Place, Place]
    lean_deg: float
    knees_out: float = 0.08


def ride(body: Body, contact: Contact) -> tuple[dict[str, Rotation], Points]:
    """Return the pose of a seated body.

    Returns:
        Rotations of the bones for `pose_body`, and the vehicle's origin, (3,), in the posed body's frame.
    """
    lean = contact.lean_deg
    rotations = {
        "pelvis": turn(x=-0.55 * lean),
        "spine_01": turn(x=-0.25 * lean - 3.0),
        "spine_02": turn(x=-0.20 * lean - 3.0),
        "spine_03": turn(x=-0.10 * lean),
        "neck_01": turn(x=0.45 * lean + 2.0),
        "head": turn(x=0.55 * lean + 3.0),
        "clavicle_l": turn(z=5.0),
        "clavicle_r": turn(z=-5.0),
    }
    trunk = pose_body(body, rotations).transforms
    bones = data.rig().bones
    hips = np.mean([moved(trunk, "pelvis", body.head(f"thigh_{s}")) for s in "lr"], axis=0)
    origin = hips - np.asarray(contact.seat) - [0.0, *_SEAT_TO_HIPS]
    tilt = turn(x=-14.0).as_matrix()
    for side, outwards, foot in (("r", 1.0, contact.foot[0]), ("l", -1.0, contact.foot[1])):
        hip = moved(trunk, "pelvis", body.head(f"thigh_{side}"))
        ball = tilt @ (body.head(f"ball_{side}") - body.head(f"foot_{side}"))
        ankle = origin + np.asarray(foot) + np.array([0.0, 0.0, _SOLE]) - ball
        pole = np.array([outwards * contact.knees_out, 1.0, 0.25])
        rotations |= leg(body, side, trunk[bones.index("pelvis")][:3, :3], hip, ankle, tilt, pole)
        rotations[f"ball_{side}"] = turn(x=8.0)
        shoulder = moved(trunk, f"clavicle_{side}", body.head(f"upperarm_{side}"))
        grip = origin + np.asarray(contact.grip) * [outwards, 1.0, 1.0]
        rotations |= arm(body, side, trunk[bones.index(f"clavicle_{side}")][:3, :3], shoulder, grip)
        rotations |= fingers(body, side, 2.7)
    return rotations, origin
