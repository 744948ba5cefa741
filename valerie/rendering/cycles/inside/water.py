# SPDX-License-Identifier: Apache-2.0
"""Rain water as Blender's shader nodes, the same as in the raster engine (``water.glsl``, ``lighting.frag.glsl``)."""

from __future__ import annotations

from typing import Any

from .nodes import new_group
from .pipe import Message
from .terms import Grain, Term, relief

#: What a cover reads and changes of a surface. What it reads as "Dry" is that of the surface without any cover.
SURFACE = {
    "Base Color": "Color", "Roughness": "Float", "Specular IOR Level": "Float", "Metallic": "Float", "Normal": "Vector",
}  # fmt: skip
DRY = {"Dry Base Color": "Color", "Dry Roughness": "Float"}


def water_group(data: Any, reliefs: list[Any], constants: Message) -> Any:
    """Return the node group of water on surfaces that face up; ``reliefs`` are those of hollows, from broad to fine.

    Pores full of water darken a surface (Lekner and Dorf 1988, doi:10.1364/AO.27.001278). The film is smooth and reflects like
    water. It stands in hollows and ruts, on soil and grass only in the deepest, and there it is level.
    """
    group, nodes, source, result = new_group(data, "water", {**SURFACE, **DRY, "Soaks": "Float"}, SURFACE)
    c = constants
    geometry = nodes.add("ShaderNodeNewGeometry").outputs
    position, face = Term(nodes, geometry["Position"]), Term(nodes, geometry["Normal"])
    color, rough, specular, metallic, normal, _, dry, soaks = (
        Term(nodes, source[name]) for name in (*SURFACE, *DRY, "Soaks")
    )
    wetness = Term(nodes, nodes.add("ShaderNodeValue", "wetness").outputs[0])
    bare, sealed = 1.0 - metallic, 1.0 - soaks
    film = wetness * face.z.step(*c["WATER_WETS"]) * bare

    lengths = (c["WATER_BROAD"], c["WATER_NARROW"], c["WATER_FINE"])
    (broad, _), (narrow, _), (fine, slopes) = (
        relief(nodes, image, position, length) for image, length in zip(reliefs, lengths, strict=True)
    )
    of_broad, of_narrow, of_fine, of_ruts = c["WATER_WEIGHTS"]
    hollow = broad * of_broad + narrow * of_narrow + fine * of_fine + (1.0 - dry.step(*c["WATER_RUTS"])) * of_ruts
    sealed_level, wetter, soaking = c["WATER_LEVEL"]
    level = wetness * wetter + soaks * soaking + sealed_level
    pool = (hollow - level).step(*c["WATER_SHORE"]) * face.z.step(*c["WATER_STANDS"]) * film

    ripples = slopes * Grain(nodes).seen(c["WATER_FINE"][0]) * c["WATER_RIPPLES"]

    smooth, on_soil, still = c["WATER_ROUGHNESS"]
    mirrors = (film * sealed).of("MAXIMUM", pool)
    filled = (film * sealed * c["WATER_FILLS"]).of("MAXIMUM", pool)
    # Half of the socket's range is a reflectance of 4 %.
    shining = specular.of("MAXIMUM", 0.5 * c["WATER_SPECULAR"])
    changed = {
        "Base Color": color * (1.0 - film * rough.step(*c["WATER_PORES"]) * (1.0 - c["WATER_DARKENS"])),
        "Roughness": rough.to(rough.of("MINIMUM", smooth).to(rough * on_soil, soaks).to(still, pool), film),
        "Specular IOR Level": specular.to(shining, mirrors),
        "Metallic": metallic,
        "Normal": (normal.to(face, filled) + ripples * pool).of("NORMALIZE"),
    }
    for name, term in changed.items():
        nodes.link(term.output, result[name])
    return group
