# SPDX-License-Identifier: Apache-2.0
"""Rain water as Blender's shader nodes, the same as in the raster engine (``water.glsl``, ``lighting.frag.glsl``)."""

from __future__ import annotations

from typing import Any

from .covers import Cover
from .pipe import Message
from .terms import relief


def water_cover(data: Any, reliefs: list[Any], constants: Message) -> Cover:
    """Return the cover of water on surfaces that face up; ``reliefs`` are those of hollows, from broad to fine.

    Pores full of water darken a surface (Lekner and Dorf 1988, doi:10.1364/AO.27.001278). The film is smooth and reflects like
    water. It stands in hollows and ruts, on soil and grass only in the deepest, and there it is level.
    """
    cover, c = Cover(data, "water", "Soaks"), constants
    face, rough, metallic, soaks, wetness = cover.face, cover.rough, cover.metallic, cover.own, cover.amount
    bare, sealed = 1.0 - metallic, 1.0 - soaks
    film = wetness * face.z.step(*c["WATER_WETS"]) * bare

    lengths = (c["WATER_BROAD"], c["WATER_NARROW"], c["WATER_FINE"])
    (broad, _), (narrow, _), (fine, slopes) = (
        relief(cover.nodes, image, cover.position, length) for image, length in zip(reliefs, lengths, strict=True)
    )
    of_broad, of_narrow, of_fine, of_ruts = c["WATER_WEIGHTS"]
    ruts = 1.0 - cover.dry_rough.step(*c["WATER_RUTS"])
    hollow = broad * of_broad + narrow * of_narrow + fine * of_fine + ruts * of_ruts
    sealed_level, wetter, soaking = c["WATER_LEVEL"]
    level = wetness * wetter + soaks * soaking + sealed_level
    pool = (hollow - level).step(*c["WATER_SHORE"]) * face.z.step(*c["WATER_STANDS"]) * film

    ripples = slopes * cover.grain.seen(c["WATER_FINE"][0]) * c["WATER_RIPPLES"]

    smooth, on_soil, still = c["WATER_ROUGHNESS"]
    mirrors = (film * sealed).of("MAXIMUM", pool)
    filled = (film * sealed * c["WATER_FILLS"]).of("MAXIMUM", pool)
    # Half of the socket's range is a reflectance of 4 %.
    shining = cover.specular.of("MAXIMUM", 0.5 * c["WATER_SPECULAR"])
    cover.change(
        cover.color * (1.0 - film * rough.step(*c["WATER_PORES"]) * (1.0 - c["WATER_DARKENS"])),
        rough.to(rough.of("MINIMUM", smooth).to(rough * on_soil, soaks).to(still, pool), film),
        cover.specular.to(shining, mirrors),
        metallic,
        (cover.normal.to(face, filled) + ripples * pool).of("NORMALIZE"),
    )
    return cover
