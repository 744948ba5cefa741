"""Parts of the messages to Blender. `inside` reads them there without this module."""

from __future__ import annotations

from typing import TypedDict


class CameraMessage(TypedDict):
    """A camera: its matrix row by row, and lengths in millimetres and metres."""

    matrix: list[float]
    focal_length_mm: float
    sensor_width_mm: float
    near: float
    far: float


class AirMessage(TypedDict):
    """Sun, air and ground, in the unit of the linear image: irradiance of the sun, radiance of haze and of the distant ground.

    The angle of the sun is in radians, extinction per metre, the depth of snow in metres, wetness and leaf litter 0 … 1.
    """

    sun: list[float]
    toward_sun: list[float]
    angular_diameter: float
    extinction: float
    haze: list[float]
    ground: list[float]
    wetness: float
    snow_depth: float
    leaf_litter: float


class BeamMessage(TypedDict):
    """The fields of `valerie.rendering.beams.DippedBeam`."""

    spread: tuple[float, float]
    rise: float
    edge: float
    stray: float


class LampMessage(TypedDict):
    """A lamp: place and unit vectors, Blender's energy and colour, angles of its cone in radians, radius in metres."""

    position: list[float]
    direction: list[float]
    up: list[float]
    energy: float
    color: list[float]
    inner: float
    outer: float
    radius: float
    beam: BeamMessage | None
