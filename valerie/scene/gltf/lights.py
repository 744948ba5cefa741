"""Lamps as KHR_lights_punctual: point and spot lights in candela.

A light of glTF shines along its node's −z, which is the node's +y here (`common`), so nodes need no further turn. The
extension has no switches, no size, no dipped beams and no glowing materials; these are in ``extras``.
"""

from __future__ import annotations

import math
from dataclasses import fields
from typing import Final

from valerie.errors import InvalidInput
from valerie.plain import JsonObject
from valerie.scene.gltf.common import EXTRAS_KEY, number, own_extras
from valerie.scene.graph.model import BEAMS, SWITCHES, Light

#: Largest angle that a spot light of glTF may have.
_WIDEST_SPOT: Final = math.pi / 2
_DEFAULT: Final = Light()


def read_light(document: JsonObject, path: str) -> Light:
    """Return the lamp of a node. A directional light is the sun, which the file's reader handles.

    Args:
        document: an entry of the file's list of lights.
        path: path of the node, for errors.

    Raises:
        InvalidInput: the kind of light is unknown, or a number is out of range.
    """
    kind = document.get("type")
    if kind not in ("point", "spot"):
        raise InvalidInput("unknown kind of light", field=path, value=kind, limit="directional, point or spot")
    own = own_extras(document.get("extras"))
    cone, color, glowing = document.get("spot"), document.get("color"), own.get("glowing")
    spot = cone if isinstance(cone, dict) else {}
    red, green, blue = (number(value, path) for value in (color if isinstance(color, list) else _DEFAULT.color))
    everywhere = kind == "point"
    light = Light(
        color=(red, green, blue),
        intensity=number(document.get("intensity", 1.0), path),
        inner=number(own.get("inner", 0.0 if everywhere else spot.get("innerConeAngle", 0.0)), path),
        outer=number(own.get("outer", math.pi if everywhere else spot.get("outerConeAngle", math.pi / 4)), path),
        beam=str(own.get("beam", _DEFAULT.beam)),
        radius=number(own.get("radius", _DEFAULT.radius), path),
        switch=str(own.get("switch", "")),
        glowing=tuple(str(name) for name in (glowing if isinstance(glowing, list) else ())),
        luminance=number(own.get("luminance", 0.0), path),
    )
    numbers = (*light.color, light.intensity, light.inner, light.outer, light.radius, light.luminance)
    if not all(math.isfinite(value) and value >= 0 for value in numbers):
        raise InvalidInput("not a valid light", field=path, value=dict(document), limit="numbers ≥ 0")
    if not light.inner <= light.outer <= math.pi:
        raise InvalidInput("a cone needs inner ≤ outer ≤ π", field=path, value=(light.inner, light.outer))
    if light.beam not in BEAMS:
        raise InvalidInput("unknown beam", field=path, value=light.beam, limit=", ".join(BEAMS))
    if light.beam == "dipped" and light.outer >= _WIDEST_SPOT:
        raise InvalidInput(
            "a dipped beam needs a cone", field=path, value=light.outer, limit="an outer angle below π/2"
        )
    if light.switch and light.switch not in SWITCHES:
        raise InvalidInput("unknown switch", field=path, value=light.switch, limit=", ".join(SWITCHES))
    return light


def write_light(light: Light) -> JsonObject:
    """Return the entry of a lamp in the file's list of lights."""
    narrow = light.outer <= _WIDEST_SPOT
    kind: JsonObject = {"type": "point"}
    if narrow:
        # The extension requires a gap between the two.
        inner = min(light.inner, max(light.outer - 1e-3, 0.0))
        kind = {"type": "spot", "spot": {"innerConeAngle": inner, "outerConeAngle": light.outer}}
    own = {
        field.name: getattr(light, field.name) for field in fields(Light) if field.name not in ("color", "intensity")
    }
    own["glowing"] = list(light.glowing)
    return {**kind, "color": list(light.color), "intensity": light.intensity, "extras": {EXTRAS_KEY: own}}
