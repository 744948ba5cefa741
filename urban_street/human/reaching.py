"""Limbs that reach a place: legs to where the feet stand, arms to what the hands hold, by two-bone inverse kinematics."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from urban_street.human import data
from urban_street.human.body import Body
from urban_street.human.surface import Points, normalize

Direction = tuple[float, float, float]


class Hold(NamedTuple):
    """How a hand holds something, as directions for the right hand (x right, y ahead, z up). The left one mirrors x.

    Attributes:
        pointing: direction from the wrist to the knuckles.
        palm: direction in which the palm faces.
        pole: direction towards which the elbow bends.
    """

    pointing: Direction
    palm: Direction
    pole: Direction


#: On the grip of a handlebar, from above.
HANDLEBAR: Final = Hold((-0.12, 1.0, -0.22), (-0.25, -0.15, -1.0), (0.75, -0.35, -0.9))


def leg(
    body: Body, side: str, pelvis: Points, hip: Points, ankle: Points, foot: Points, pole: Points
) -> dict[str, Rotation]:
    """Return the rotations of thigh, calf and foot.

    Args:
        side: ``l`` or ``r``.
        pelvis: (3, 3) orientation of the pelvis.
        hip, ankle: (3,) places of the posed hip joint and of the goal of the ankle.
        foot: (3, 3) orientation of the foot.
        pole: (3,) direction towards which the knee bends.
    """
    thigh, calf, end = (body.head(f"{name}_{side}") for name in ("thigh", "calf", "foot"))
    knee = _joint(hip, ankle, float(np.linalg.norm(calf - thigh)), float(np.linalg.norm(end - calf)), pole)
    hinge = normalize(np.cross(knee - hip, ankle - knee))
    rest = np.array([-1.0, 0.0, 0.0])
    upper = _frame(knee - hip, hinge) @ _frame(calf - thigh, rest).T
    lower = _frame(ankle - knee, hinge) @ _frame(end - calf, rest).T
    return {
        f"thigh_{side}": Rotation.from_matrix(pelvis.T @ upper),
        f"calf_{side}": Rotation.from_matrix(upper.T @ lower),
        f"foot_{side}": Rotation.from_matrix(lower.T @ foot),
    }


def arm(
    body: Body, side: str, clavicle: Points, shoulder: Points, grip: Points, hold: Hold = HANDLEBAR
) -> dict[str, Rotation]:
    """Return the rotations of upper arm, forearm and hand, whose palm lies at ``grip``, (3,).

    Args:
        side: ``l`` or ``r``.
        clavicle: (3, 3) orientation of the clavicle.
        shoulder: (3,) place of the posed shoulder joint.
    """
    outwards = 1.0 if side == "r" else -1.0
    upper, fore, hand, finger = (body.head(f"{name}_{side}") for name in ("upperarm", "lowerarm", "hand", "middle_01"))
    across = body.head(f"index_01_{side}") - body.head(f"pinky_01_{side}")
    palm = normalize(np.cross(finger - hand, across))
    thumb = body.tail(f"thumb_03_{side}") - hand
    if thumb @ palm < 0.0:
        palm = -palm
    mirror = np.array([outwards, 1.0, 1.0])
    pointing, down = normalize(mirror * hold.pointing), normalize(mirror * hold.palm)
    turn = _frame(pointing, down) @ _frame(finger - hand, palm).T
    # The palm, which is under the knuckles, lies on the grip.
    wrist = grip - turn @ (0.92 * (finger - hand) + 0.028 * palm)
    pole = mirror * hold.pole
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


def moved(transforms: Points, bone: str, point: Points) -> Points:
    """Return where a point of the rest pose, (3,), is with a posed bone."""
    matrix = transforms[data.rig().bones.index(bone)]
    return np.asarray(matrix[:3, :3] @ point + matrix[:3, 3])
