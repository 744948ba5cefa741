"""Cameras in the form of Cityscapes' ``camera`` files.

Extrinsics lead from the camera's axes to the vehicle's as in ISO 8855: x forward, y left, z up, with R = Rz(yaw) · Ry(pitch) ·
Rx(roll), radians; a positive pitch looks *down* (Cityscapes' csCalibration.pdf). A scene has no vehicle. The world's origin
takes its place, facing ahead (+y). Image coordinates count pixel centres from 0, so the principal point of a centred
camera is ((W − 1) / 2, (H − 1) / 2).
"""

from __future__ import annotations

import math
from typing import TypedDict

from valerie.scene.graph.model import Camera
from valerie.scene.graph.transforms import camera_angles


class Extrinsic(TypedDict):
    """Position and direction of a camera: baseline, x, y, z in metres; yaw, pitch, roll in radians."""

    baseline: float
    x: float
    y: float
    z: float
    yaw: float
    pitch: float
    roll: float


class Intrinsic(TypedDict):
    """The pinhole camera: focal lengths and principal point in pixels."""

    fx: float
    fy: float
    u0: float
    v0: float


class CameraDocument(TypedDict):
    """One ``camera`` file."""

    extrinsic: Extrinsic
    intrinsic: Intrinsic


def camera_document(camera: Camera, width: int, height: int) -> CameraDocument:
    """Return the document of a camera.

    Args:
        camera: a camera in the world: z up, y ahead.
        width, height: size of the image, square pixels.
    """
    x, y, z = (float(value) for value in camera.position)
    yaw, pitch, roll = (math.radians((angle + 180.0) % 360.0 - 180.0) for angle in camera_angles(camera.transform))
    focal = camera.focal_length_px(width)
    return {
        "extrinsic": {"baseline": 0.0, "x": y, "y": -x + 0.0, "z": z, "yaw": yaw, "pitch": -pitch + 0.0, "roll": roll},
        "intrinsic": {"fx": focal, "fy": focal, "u0": (width - 1) / 2, "v0": (height - 1) / 2},
    }
