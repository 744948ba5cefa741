"""Sitting on a bicycle or motorcycle: hands on the grips, feet on the pedals, by two-bone inverse kinematics."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from urban_street.human import data
from urban_street.human.body import Body
from urban_street.human.pose import fingers, pose_body, turn
from urban_street.human.surface import Points, normalize

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
    hips = np.mean([_moved(trunk, bones, "pelvis", body.head(f"thigh_{s}")) for s in "lr"], axis=0)
    origin = hips - np.asarray(contact.seat) - [0.0, *_SEAT_TO_HIPS]
    for side, outwards, foot in (("r", 1.0, contact.foot[0]), ("l", -1.0, contact.foot[1])):
        hip = _moved(trunk, bones, "pelvis", body.head(f"thigh_{side}"))
        rotations |= _leg(
            body, side, outwards, trunk[bones.index("pelvis")][:3, :3], hip, origin + np.asarray(foot), contact
        )
        shoulder = _moved(trunk, bones, f"clavicle_{side}", body.head(f"upperarm_{side}"))
        grip = origin + np.asarray(contact.grip) * [outwards, 1.0, 1.0]
        rotations |= _arm(body, side, outwards, trunk[bones.index(f"clavicle_{side}")][:3, :3], shoulder, grip)
        rotations |= fingers(body, side, 2.7)
    return rotations, origin


def _leg(
    body: Body, side: str, outwards: float, pelvis: Points, hip: Points, pedal: Points, contact: Contact
) -> dict[str, Rotation]:
    thigh, calf, foot, ball = (body.head(f"{name}_{side}") for name in ("thigh", "calf", "foot", "ball"))
    tilt = turn(x=-14.0).as_matrix()
    target = pedal + np.array([0.0, 0.0, _SOLE]) - tilt @ (ball - foot)
    pole = np.array([outwards * contact.knees_out, 1.0, 0.25])
    knee = _joint(hip, target, float(np.linalg.norm(calf - thigh)), float(np.linalg.norm(foot - calf)), pole)
    hinge = normalize(np.cross(knee - hip, target - knee))
    rest = np.array([-1.0, 0.0, 0.0])
    upper = _frame(knee - hip, hinge) @ _frame(calf - thigh, rest).T
    lower = _frame(target - knee, hinge) @ _frame(foot - calf, rest).T
    return {
        f"thigh_{side}": Rotation.from_matrix(pelvis.T @ upper),
        f"calf_{side}": Rotation.from_matrix(upper.T @ lower),
        f"foot_{side}": Rotation.from_matrix(lower.T @ tilt),
        f"ball_{side}": turn(x=8.0),
    }


def _arm(
    body: Body, side: str, outwards: float, clavicle: Points, shoulder: Points, grip: Points
) -> dict[str, Rotation]:
    upper, fore, hand, finger = (body.head(f"{name}_{side}") for name in ("upperarm", "lowerarm", "hand", "middle_01"))
    across = body.head(f"index_01_{side}") - body.head(f"pinky_01_{side}")
    palm = normalize(np.cross(finger - hand, across))
    thumb = body.tail(f"thumb_03_{side}") - hand
    if thumb @ palm < 0.0:
        palm = -palm
    pointing = normalize(np.array([-0.12 * outwards, 1.0, -0.22]))
    down = normalize(np.array([-0.25 * outwards, -0.15, -1.0]))
    turn = _frame(pointing, down) @ _frame(finger - hand, palm).T
    # The palm, which is under the knuckles, lies on the grip.
    wrist = grip - turn @ (0.92 * (finger - hand) + 0.028 * palm)
    pole = np.array([outwards * 0.75, -0.35, -0.9])
    elbow = _joint(shoulder, wrist, float(np.linalg.norm(fore - upper)), float(np.linalg.norm(hand - fore)), pole)
    rest = normalize(np.cross(fore - upper, [0.0, 1.0, 0.0]))
    hinge = normalize(np.cross(elbow - shoulder, wrist - elbow))
    first = _frame(elbow - shoulder, hinge) @ _frame(fore - upper, rest).T
    second = _frame(wrist - elbow, hinge) @ _frame(hand - fore, rest).T
    return {
        f"upperarm_{side}": Rotation.from_matrix(clavicle.T @ first),
        f"lowerarm_{side}": Rotation.from_matrix(first.T @ second),
        f"hand_{side}": Rotation.from_matrix(second.T @ turn),
    }


def _joint(start: Points, end: Points, first: float, second: float, pole: Points) -> Points:
    """Return the place of knee or elbow, (3,), towards ``pole``. A limb stretches to at most 99.7 % of its length."""
    line = end - start
    length = float(np.linalg.norm(line))
    along = line / length
    reach = min(length, 0.997 * (first + second))
    place = (first**2 - second**2 + reach**2) / (2.0 * reach)
    off = normalize(pole - (pole @ along) * along)
    return np.asarray(start + along * place + off * np.sqrt(max(first**2 - place**2, 0.0)))


def _frame(direction: Points, hinge: Points) -> Points:
    """Return the (3, 3) columns: direction, hinge made perpendicular to it, and their cross product."""
    ahead = normalize(direction)
    axis = normalize(hinge - (hinge @ ahead) * ahead)
    return np.column_stack([ahead, axis, np.cross(ahead, axis)])


def _moved(transforms: Points, bones: tuple[str, ...], bone: str, point: Points) -> Points:
    matrix = transforms[bones.index(bone)]
    return np.asarray(matrix[:3, :3] @ point + matrix[:3, 3])
