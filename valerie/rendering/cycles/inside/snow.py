# SPDX-License-Identifier: Apache-2.0
"""Lying snow as Blender's shader nodes, the same as in the raster engine (``lying.glsl``, ``lighting.frag.glsl``)."""

from __future__ import annotations

from typing import Any

from .covers import Cover
from .pipe import Message
from .terms import Term, relief, vector


def snow_cover(data: Any, reliefs: list[Any], constants: Message) -> Cover:
    """Return the cover of snow on surfaces that face up, but also below roofs; ``reliefs`` are from long to short.

    The share that snow covers is tanh(depth / 25 mm), in patches with random borders. Traffic compacts it, and keeps polished
    tracks bare, damp and slushy.
    """
    cover, c = Cover(data, "snow", "Traffic"), constants
    nodes, face, traffic, fallen = cover.nodes, cover.face, cover.own, cover.amount

    height: Any = 0.0
    spread: Any = 1e-6
    visible: Any = 0.0
    dunes, border = vector(nodes), vector(nodes)
    for image, length, share in zip(reliefs, c["SNOW_LENGTHS"], c["SNOW_WEIGHTS"], strict=True):
        level, slopes = relief(nodes, image, cover.position, (length, length))
        weight = cover.grain.seen(length) * share
        height, spread, visible = (level - 0.5) * weight + height, weight * weight + spread, weight + visible
        dunes, border = dunes + slopes * weight, border + slopes * weight * (1.0 / length)
    by_slope, by_roughness = c["SNOW_RAGGED"]
    # Tyres polish asphalt, but less than oil and bitumen are smooth. Markings are bright. Tracks have ragged edges.
    polish, driven = cover.dry_rough - height * by_roughness, traffic * cover.dry_rough.step(*c["SNOW_DRIVEN"])
    worn = driven * (1.0 - polish.step(*c["SNOW_TRACK"])) * (1.0 - cover.dry_color.y.step(*c["SNOW_MARKING"]))
    everywhere, from_tracks, _ = c["SNOW_TAKEN"]
    slope = (face.z + height * (1.0 - face.z) * by_slope).step(*c["SNOW_SLOPE"])
    depth = fallen * slope * (1.0 - traffic * everywhere) * (1.0 - worn * from_tracks)
    covered = (depth * (1.0 / c["SNOW_COVERING"])).of("TANH")
    # The logistic curve is that of a normal distribution within 0.01.
    steep = 1.702 / (spread.of("SQRT") * c["RELIEF_DEVIATION"])
    rank = 1.0 / ((height * steep * -1.0).of("EXPONENT") + 1.0)
    soft = covered.of("MINIMUM", 1.0 - covered).of("MINIMUM", c["SNOW_SOFT"]).of("MAXIMUM", 1e-4)
    inside = (covered - rank) / soft
    visible = visible.of("MINIMUM", 1.0)
    snow = covered.to(inside.step(-1.0, 1.0), visible)
    # Towards a border the snow thins out: a slope towards higher ranks.
    edge, thickness = 1.0 - (inside * inside).of("MINIMUM", 1.0), (depth * 0.5).of("MINIMUM", c["SNOW_THICKNESS"])
    fall = border * (edge * thickness * rank * (1.0 - rank) * steep / soft)
    fall = fall * (c["SNOW_STEEPEST"] / fall.length().of("MAXIMUM", 1e-4)).of("MINIMUM", 1.0)
    untouched, more = c["SNOW_DUNES"]
    up = vector(nodes, 0.0, 0.0, 1.0)
    rounded = face.to(up, snow * c["SNOW_ROUNDS"]).of("NORMALIZE") + fall - dunes * (traffic * more + untouched)
    by_traffic, in_slush = c["SNOW_DIRT"]
    slush = driven * (1.0 - polish.step(*c["SNOW_SLUSHY"])) * in_slush
    dirt = ((traffic * by_traffic).of("MAXIMUM", slush) + worn).clamped(0.0, 1.0)

    # Melt water wets the bare tracks. Snow stands higher than the bare ground at its edge, and shades it.
    damp = traffic * (1.0 - snow) * dirt * fallen.step(0.0, c["SNOW_DAMP"])
    shore = (1.0 - snow) * inside.step(-3.0, -1.0) * visible
    bare = cover.color * (1.0 - damp * (1.0 - c["SNOW_DAMP_ALBEDO"])) * (1.0 - shore * c["SNOW_SHADES"])
    white = Term(nodes, nodes.color(c["SNOW_WHITE"])).to(tuple(c["SNOW_SLUSH"]), dirt)
    damp_roughness, share = c["SNOW_DAMP_ROUGHNESS"]
    cover.change(
        bare.to(white, snow),
        cover.rough.to(damp_roughness, damp * share).to(c["SNOW_ROUGHNESS"], snow),
        # Half of the socket's range is a reflectance of 4 %.
        cover.specular.to(0.5 * c["SNOW_SPECULAR"], snow),
        cover.metallic * (1.0 - snow),
        cover.normal.to(rounded.of("NORMALIZE"), snow).of("NORMALIZE"),
    )
    return cover
