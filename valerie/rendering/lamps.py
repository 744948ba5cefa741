"""The lamps of a scene that are on, their strength in the image's unit, and the materials that glow."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from valerie.color import LUMINANCE
from valerie.rendering.beams import DIPPED
from valerie.rendering.scene_reading import lights
from valerie.rendering.sky import LUX, Sky
from valerie.scene.graph.model import SWITCHES, Material, Scene

Vector = tuple[float, float, float]

#: Illuminance that counts as dark, lux. The light of a lamp fades to exactly zero at the distance where it would give this
#: (`Lamp.reach`).
_DARK_LUX: Final = 0.02
#: Largest reach of a lamp, metres.
_FARTHEST: Final = 150.0
#: Illuminance of the darkest street to which a metering camera adapts, lux: that of street lamps.
_ADAPTED_LUX: Final = 20.0
#: Brightest channel of a signal in the dark, over that of a white surface. Above it, further channels would clip.
_BRIGHTEST: Final = 1.7
#: Illuminance that raises this bound by 1, lux. By day, no lamp reaches it.
_RAISING_LUX: Final = 2_000.0


@dataclass(frozen=True, slots=True)
class Lamp:
    """A lamp that is on, in the world.

    In its brightest direction, a white Lambertian surface that faces the lamp at distance d (metres) has the image value
    ``strength`` / d².

    Attributes:
        position: metres.
        direction: unit vector along the axis.
        up: unit vector perpendicular to the axis; a dipped beam's cut-off is level with respect to it.
        strength: image value · m², linear RGB.
        inner, outer: radians from the axis, see `Light`.
        dipped: True if the light has the distribution `beams.DIPPED`.
        radius: radius of the luminous surface, metres.
        reach: distance beyond which the light is exactly zero, metres.
        movable: True if the lamp is part of a movable.
    """

    position: Vector
    direction: Vector
    up: Vector
    strength: Vector
    inner: float
    outer: float
    dipped: bool
    radius: float
    reach: float
    movable: bool

    @property
    def flux(self) -> Vector:
        """Total light of the lamp, image value · m² · sr, linear RGB."""
        if self.dipped:
            steradian = DIPPED.flux()
        elif self.outer >= math.pi:
            steradian = 4.0 * math.pi
        else:
            inner, outer = math.cos(self.inner), math.cos(self.outer)
            # Between the cones the intensity is the square of a line from 1 to 0, whose mean is a third.
            steradian = 2.0 * math.pi * (1.0 - inner + (inner - outer) / 3.0)
        return _vector(np.array(self.strength) * steradian)


def lit_lamps(scene: Scene, sky: Sky) -> tuple[Lamp, ...]:
    """Return the visible lamps that are on, in the scene's order."""
    lamps: list[Lamp] = []
    for item in lights(scene):
        world, light = item.world, item.node.light
        if light is None or light.intensity <= 0 or not is_on(light.switch, scene, sky):
            continue
        color = np.array(light.color)
        luminance = float(color @ LUMINANCE)
        if luminance <= 0:
            continue
        strength = color / luminance * (light.intensity * LUX)
        axis = world[:3, 1] / np.linalg.norm(world[:3, 1])
        right = np.cross(axis, world[:3, 2])
        up = np.cross(right / np.linalg.norm(right), axis)
        reach = min(math.sqrt(light.intensity / _DARK_LUX), _FARTHEST)
        lamps.append(
            Lamp(
                _vector(world[:3, 3]), _vector(axis), _vector(up), _vector(strength), light.inner, light.outer,
                light.beam == "dipped", light.radius, reach, item.node.movable,
            )
        )  # fmt: skip
    return tuple(lamps)


def is_on(switch: str, scene: Scene, sky: Sky) -> bool:
    """Return True if a switch is on, or empty. ``auto`` depends on the illuminance of the ground by sun and sky."""
    if not switch:
        return True
    position: str = getattr(scene.environment, f"{switch}_lamps")
    return position == "on" or (position == "auto" and sky.lux < SWITCHES[switch])


def glowing(scene: Scene, sky: Sky) -> Scene:
    """Return the scene with the glowing materials of lamps that are on; the scene itself if there are none.

    A material glows if any lamp that names it is on, even a hidden one. Equal materials are the same object at each call, since
    engines cache by identity.
    """
    replacements: dict[str, Material] = {}
    for node in scene.nodes.values():
        light = node.light
        if light is None or not light.glowing or light.luminance <= 0 or not is_on(light.switch, scene, sky):
            continue
        for name in light.glowing:
            material = scene.materials.get(name)
            if material is not None:
                replacements[name] = _lit(material, light.color, light.luminance)
    return replace(scene, materials={**scene.materials, **replacements}) if replacements else scene


def with_lit_rooms(scene: Scene, sky: Sky) -> Scene:
    """Return the scene with the light of rooms behind panes as the emissive light of their materials, as in `glowing`."""
    if not is_on("street", scene, sky):
        return scene
    lit = {m.name: _lit(m, (1.0, 1.0, 1.0), m.rooms.luminance) for m in scene.materials.values() if m.rooms is not None}
    return replace(scene, materials={**scene.materials, **lit}) if lit else scene


@lru_cache(maxsize=256)
def _lit(material: Material, color: Vector, luminance: float) -> Material:
    tint = np.array(color) / max(float(np.array(color) @ LUMINANCE), 1e-9)
    # A white Lambertian surface has the luminance L under an illuminance of π L lux.
    return replace(material, emissive=_vector(np.array(material.emissive) + tint * (math.pi * luminance * LUX)))


def keeping_hue(scene: Scene, sky: Sky) -> Scene:
    """Return the scene with signals no brighter than a camera that is exposed for the scene can show in their hue.

    A red signal in the dark is thousands of times brighter than its surroundings. All channels would clip, and it would be white
    in the picture. By day, it keeps its radiance. Equal materials are the same object at each call.
    """
    bound = LUX * max(sky.lux, _ADAPTED_LUX) * (_BRIGHTEST + sky.lux / _RAISING_LUX)
    toned = {m.name: _toned(m, bound) for m in scene.materials.values() if m.signal and max(m.emissive) > bound}
    return replace(scene, materials={**scene.materials, **toned}) if toned else scene


@lru_cache(maxsize=256)
def _toned(material: Material, bound: float) -> Material:
    return replace(material, emissive=_vector(np.array(material.emissive) * (bound / max(material.emissive))))


def _vector(values: NDArray[np.float64]) -> Vector:
    x, y, z = (float(value) for value in values)
    return x, y, z
