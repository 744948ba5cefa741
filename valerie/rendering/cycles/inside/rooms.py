# SPDX-License-Identifier: Apache-2.0
"""Rooms behind panes as Blender's shader nodes, the same as in the raster engine (``rooms.glsl``)."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from .nodes import Nodes
from .pipe import Message
from .terms import Term, vector


class Pane(NamedTuple):
    """What a pane shows: linear colour behind it, 1 where lamps light the room, else 0, and the normal of the bent glass."""

    color: Term
    lamps: Term | None
    normal: Term


def behind_pane(nodes: Nodes, image: Any, rooms: Message, constants: Message, *, lit: bool) -> Pane:
    """Return what lies behind a pane: the ray ends at a wall of an imaginary box, whose picture is in perspective.

    Args:
        image: the pictures of the rooms, sRGB values without conversion.
        rooms: number of cells, width and depth, see `valerie.scene.graph.model.Rooms`. The mesh has the attributes ``right`` and
            ``down``, the sides of a cell.
        lit: the lamps are on.
    """
    front, cells = constants["ROOM_FRONT"], rooms["cells"]
    geometry = nodes.add("ShaderNodeNewGeometry").outputs
    normal, ray = Term(nodes, geometry["Normal"]), Term(nodes, geometry["Incoming"]) * -1.0
    right, down = _side(nodes, "right"), _side(nodes, "down")
    wide, high = right.length(), down.length()
    size = vector(nodes, wide, high, 1.0) * (2.0 * front, 2.0 * front, 1.0)
    right, down = right.of("NORMALIZE"), down.of("NORMALIZE")
    uv = nodes.add("ShaderNodeUVMap")
    uv.uv_map = "uv"
    place = (Term(nodes, uv.outputs[0]) * (1.0, -1.0, 0.0) + (0.0, 1.0, 0.0)) * float(cells)
    cell = place.of("FLOOR")
    at = (place - cell - 0.5) * (0.5 / front, 0.5 / front, 0.0)

    d = vector(nodes, ray.dot(right), ray.dot(down), (ray.dot(normal) * -1.0).of("MAXIMUM", 1e-3))
    # The box: the middle of the pane is 0, down is positive.
    top = size.y * -0.5 - constants["ROOM_CEILING"]
    base = (size.y * 0.5).of("MAXIMUM", size.y * -0.5 + constants["ROOM_STOREY"])
    width = (size.x * constants["ROOM_PANES"]).of("MAXIMUM", rooms["width"])
    extent = vector(nodes, width * 0.5, (base - top) * 0.5, rooms["depth"])
    start = (at * size - vector(nodes, 0.0, (base + top) * 0.5)) / extent
    way = d / extent
    ends = (1.0 - start * way.of("SIGN")) / way.of("ABSOLUTE").of("MAXIMUM", 1e-5)
    hit = start + way * ends.x.of("MINIMUM", ends.y).of("MINIMUM", ends.z)
    seen = (hit / (hit.z + 1.0)).clamped(-1.0, 1.0)
    hung = (at + d / d.z * constants["ROOM_HANGS"] / size).clamped(-0.5, 0.5)

    def picture(inside: Term, quarter: tuple[Any, float]) -> Any:
        # Blender's texture coordinates point upwards.
        on = (cell + 0.5 + inside) * (0.5 / cells, -0.5 / cells, 0.0) + (0.0, 1.0, 0.0)
        outputs = nodes.image(image, (on + vector(nodes, quarter[0], -quarter[1])).output)
        return Term(nodes, outputs["Color"]), Term(nodes, outputs["Alpha"])

    room, lamps = picture(seen * front, (0.0, 0.0))[0], None
    if lit:
        by_lamps, alpha = picture(seen * front, (0.5, 0.0))
        lamps = alpha.of("GREATER_THAN", 0.4999)
        room = room.to(by_lamps, lamps)
    cloth, cover = picture(hung * (2.0 * front), (lamps * 0.5 if lamps is not None else 0.0, 0.5))
    encoded = room.to(cloth, cover)
    # sRGB, without its straight part below 0.003, from which it differs by at most 0.001.
    color = ((encoded + 0.055) * (1 / 1.055)).of("POWER", 2.4)

    turns = vector(nodes, cell.dot((0.618, 0.570, 0.0)), cell.dot((0.380, 0.755, 0.0))).of("FRACTION")
    waves = ((at * (1.0, 0.7, 0.0) + turns) * (2 * math.pi)).of("SINE")
    slope = (waves + vector(nodes, turns.y, turns.x) * 2.0 - 1.0) * (0.5 * constants["GLASS_BENT"])
    return Pane(color, lamps, (normal + right * slope.x + down * slope.y).of("NORMALIZE"))


def _side(nodes: Nodes, name: str) -> Term:
    """Return a side of a cell in the world, metres."""
    attribute, turned = nodes.add("ShaderNodeAttribute"), nodes.add("ShaderNodeVectorTransform")
    attribute.attribute_name = name
    turned.vector_type, turned.convert_from, turned.convert_to = "VECTOR", "OBJECT", "WORLD"
    nodes.link(attribute.outputs["Vector"], turned.inputs[0])
    return Term(nodes, turned.outputs[0])
