# SPDX-License-Identifier: Apache-2.0
"""Formulas as shader nodes."""

from __future__ import annotations

from typing import Any

from .nodes import Nodes


class Term:
    """A number or a vector that nodes compute. Arithmetic with terms, outputs, numbers and tuples adds nodes."""

    def __init__(self, nodes: Nodes, output: Any) -> None:
        self._nodes = nodes
        self.output = output

    def of(self, operation: str, *operands: Any) -> Term:
        """Return the result of one of Blender's mathematical operations; of vectors if any operand is one."""
        values = [getattr(value, "output", value) for value in (self, *operands)]
        return Term(self._nodes, self._nodes.calculated(operation, *values))

    def __add__(self, other: Any) -> Term:
        return self.of("ADD", other)

    def __mul__(self, other: Any) -> Term:
        return self.of("MULTIPLY", other)

    __radd__, __rmul__ = __add__, __mul__

    def __sub__(self, other: Any) -> Term:
        return self.of("SUBTRACT", other)

    def __rsub__(self, other: Any) -> Term:
        return (self * -1.0).of("ADD", other)

    def __truediv__(self, other: Any) -> Term:
        return self.of("DIVIDE", other)

    def __rtruediv__(self, other: float) -> Term:
        return self.of("POWER", -1.0).of("MULTIPLY", other)

    def __getattr__(self, axis: str) -> Term:
        """Return a component: x, y or z."""
        if axis not in ("x", "y", "z"):
            raise AttributeError(axis)
        parts = self._nodes.add("ShaderNodeSeparateXYZ")
        self._nodes.link(self.output, parts.inputs[0])
        for name in ("x", "y", "z"):
            setattr(self, name, Term(self._nodes, parts.outputs[name.upper()]))
        part: Term = self.__dict__[axis]
        return part

    def dot(self, other: Any) -> Term:
        return Term(self._nodes, self._nodes.dot(self.output, getattr(other, "output", other)))

    def length(self) -> Term:
        return self.dot(self).of("SQRT")

    def clamped(self, low: float, high: float) -> Term:
        return self.of("MAXIMUM", low).of("MINIMUM", high)

    def step(self, low: Any, high: Any) -> Term:
        """Return GLSL's smooth step of a number, from 0 below ``low`` to 1 above ``high``."""
        return Term(self._nodes, self._nodes.smoothstep(low, high, self.output))

    def to(self, other: Any, share: Any) -> Term:
        """Return the linear blend with another term, whose share is ``share``."""
        return (self * -1.0).of("ADD", other).of("MULTIPLY", share) + self


def vector(nodes: Nodes, *parts: Any) -> Term:
    """Return a vector of up to three numbers; missing ones are 0."""
    node = nodes.add("ShaderNodeCombineXYZ")
    nodes.feed(node, [getattr(part, "output", part) for part in parts])
    return Term(nodes, node.outputs[0])


class Grain:
    """Metres of ground that a pixel covers along the view. Shorter details are replaced by their mean (``relief.glsl``)."""

    def __init__(self, nodes: Nodes) -> None:
        geometry = nodes.add("ShaderNodeNewGeometry").outputs
        facing = Term(nodes, geometry["Normal"]).dot(geometry["Incoming"]).of("ABSOLUTE").of("MAXIMUM", 0.05)
        depth = Term(nodes, nodes.add("ShaderNodeCameraData").outputs["View Z Depth"]).of("ABSOLUTE")
        # A pixel at a depth of 1 m.
        self.pixel: Any = nodes.add("ShaderNodeValue").outputs[0]
        self.length: Term = depth * self.pixel / facing

    def seen(self, length: float) -> Term:
        """Return the share of details of a length, in metres, that shows."""
        return 1.0 - self.length.step(0.25 * length, length)


def random_of(nodes: Nodes, cell: Term) -> Term:
    """Return the raster engine's random number of a cell, a vector of whole numbers (``lighting.frag.glsl``)."""
    p = (cell * (0.1031, 0.1030, 0.0973)).of("FRACTION")
    p = p + p.dot(vector(nodes, p.y, p.z, p.x) + 33.33)
    return ((p.x + p.y) * p.z).of("FRACT")


def relief(nodes: Nodes, image: Any, position: Term, lengths: Any) -> tuple[Term, Term]:
    """Return the height of the raster engine's random relief and its slopes, a vector (``relief.glsl``).

    Args:
        image: the heights at the corners of the cells.
        position: the place, metres.
        lengths: the size of a cell along x and y, metres.
    """
    place = position * (1.0 / lengths[0], 1.0 / lengths[1], 0.0)
    cell = place.of("FLOOR")
    t = place - cell
    s, slope = t * t * (3.0 - t * 2.0), t * (1.0 - t) * 6.0
    corners = nodes.image(image, ((cell + 0.5) * (1.0 / image.size[0]) + 0.5).output, closest=True)
    first, d = Term(nodes, corners["Color"]), Term(nodes, corners["Alpha"])
    a, b, c = first.x, first.y, first.z
    twist = a - b - c + d
    height = a + (b - a) * s.x + (c - a) * s.y + twist * s.x * s.y
    return height, slope * vector(nodes, b - a + twist * s.y, c - a + twist * s.x)
