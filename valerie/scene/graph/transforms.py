"""Rotations, poses and camera angles: degrees for users, matrices for the scene (docs/conventions.md).

Right-handed, z up. A node's rotation is R = Rz(z) · Ry(y) · Rx(x); heading is z: 0 faces +y, counter-clockwise seen
from above. Whole quarter turns give exact zeros and ones, so that equal poses give equal bytes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Matrix = NDArray[np.float64]

_QUARTERS = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))
#: Columns: the camera's x (right), y (up) and z (backwards) axes in the world at yaw = pitch = roll = 0.
_CAMERA_AT_REST = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


def cos_sin(degrees: float) -> tuple[float, float]:
    """Return cosine and sine of an angle in degrees, exact at multiples of 90."""
    quarters, rest = divmod(degrees, 90.0)
    if rest == 0.0:
        return _QUARTERS[int(quarters) % 4]
    radians = math.radians(degrees)
    return math.cos(radians), math.sin(radians)


def rotation(x_deg: float, y_deg: float, z_deg: float) -> Matrix:
    """Return the (3, 3) rotation Rz · Ry · Rx: about x first, about z last, all about the parent's axes."""
    (cx, sx), (cy, sy), (cz, sz) = cos_sin(x_deg), cos_sin(y_deg), cos_sin(z_deg)
    return np.array(
        [
            [cz * cy, cz * sy * sx - sz * cx, cz * sy * cx + sz * sx],
            [sz * cy, sz * sy * sx + cz * cx, sz * sy * cx - cz * sx],
            [-sy, cy * sx, cy * cx],
        ]
    )


def rotation_angles(matrix: NDArray[np.float64]) -> tuple[float, float, float]:
    """Return the angles in degrees for which `rotation` (x, y, z) is ``matrix`` (3, 3); x and z in [0, 360), y in [−90, 90].

    If y is ±90 (gimbal lock), x is 0.
    """
    sine = min(1.0, max(-1.0, -float(matrix[2, 0])))
    if abs(sine) > 1.0 - 1e-12:
        x, z = 0.0, math.atan2(-float(matrix[0, 1]), float(matrix[1, 1]))
    else:
        x = math.atan2(float(matrix[2, 1]), float(matrix[2, 2]))
        z = math.atan2(float(matrix[1, 0]), float(matrix[0, 0]))
    return _turn(math.degrees(x)), math.degrees(math.asin(sine)) + 0.0, _turn(math.degrees(z))


def _turn(degrees: float) -> float:
    angle = degrees % 360.0
    return 0.0 if angle == 360.0 else angle + 0.0


@dataclass(frozen=True, slots=True)
class Pose:
    """A translation in metres, rotation angles in degrees (see `rotation`), and a scale along the object's own axes."""

    position: tuple[float, float, float]
    angles: tuple[float, float, float]
    scale: tuple[float, float, float] = (1.0, 1.0, 1.0)

    @classmethod
    def of(cls, matrix: Matrix) -> Pose:
        """Split a (4, 4) matrix into translation, rotation and positive scale. Shear and mirroring are lost."""
        linear = np.asarray(matrix[:3, :3], np.float64)
        lengths = np.linalg.norm(linear, axis=0)
        # The columns of a computed rotation have lengths such as 1 ± 1e−16, which is not a scale.
        lengths[np.abs(lengths - 1.0) < 1e-12] = 1.0
        x, y, z = (float(v) for v in matrix[:3, 3])
        sx, sy, sz = (float(v) for v in lengths)
        return cls((x, y, z), rotation_angles(linear / np.where(lengths > 0, lengths, 1.0)), (sx, sy, sz))

    def matrix(self) -> Matrix:
        """Return the (4, 4) matrix, object to parent."""
        result = np.eye(4)
        result[:3, :3] = rotation(*self.angles) * np.asarray(self.scale) + 0.0  # −0.0 becomes 0.0
        result[:3, 3] = self.position
        return result


def place(x: float, y: float, z: float = 0.0, heading_deg: float = 0.0) -> Matrix:
    """Return the (4, 4) matrix of an upright object at (x, y, z), turned by ``heading_deg`` (0 faces +y)."""
    return Pose((x, y, z), (0.0, 0.0, heading_deg)).matrix()


def camera_transform(position: tuple[float, float, float], yaw: float, pitch: float, roll: float) -> Matrix:
    """Return the (4, 4) matrix, camera to world, for an optical centre (metres) and three angles (degrees).

    At rest the camera looks along +y with z up. ``yaw`` turns it counter-clockwise seen from above (to the left),
    ``pitch`` turns it up, and ``roll`` lowers its right side (the horizon turns counter-clockwise in the image).
    """
    result = np.eye(4)
    result[:3, :3] = rotation(0.0, 0.0, yaw) @ rotation(pitch, 0.0, 0.0) @ rotation(0.0, roll, 0.0) @ _CAMERA_AT_REST
    result[:3, :3] += 0.0  # −0.0 becomes 0.0
    result[:3, 3] = position
    return result


def camera_angles(transform: Matrix) -> tuple[float, float, float]:
    """Return yaw, pitch and roll of a camera, degrees in [0, 360), pitch in [−90, 90]: the inverse of `camera_transform`."""
    world = np.asarray(transform[:3, :3], np.float64)
    forward = -world[:, 2] / np.linalg.norm(world[:, 2])
    pitch = math.degrees(math.asin(min(1.0, max(-1.0, float(forward[2])))))
    if abs(float(forward[2])) > 1.0 - 1e-12:
        # Straight up or down, yaw and roll are the same turn. All of it counts as yaw.
        return _turn(math.degrees(math.atan2(float(world[1, 0]), float(world[0, 0])))), pitch, 0.0
    yaw = math.degrees(math.atan2(-float(forward[0]), float(forward[1])))
    unrolled = camera_transform((0.0, 0.0, 0.0), yaw, pitch, 0.0)[:3, :3]
    relative = unrolled.T @ world
    return _turn(yaw), pitch + 0.0, _turn(math.degrees(math.atan2(-float(relative[1, 0]), float(relative[0, 0]))))
