# SPDX-License-Identifier: Apache-2.0
"""Shader node trees."""

from __future__ import annotations

from typing import Any


class Nodes:
    """A node tree, emptied first."""

    def __init__(self, tree: Any) -> None:
        self._tree = tree
        tree.nodes.clear()

    def add(self, kind: str, name: str = "") -> Any:
        node = self._tree.nodes.new(kind)
        if name:
            node.name = name
        return node

    def link(self, output: Any, target: Any) -> None:
        self._tree.links.new(output, target)

    def color(self, rgb: Any) -> Any:
        node = self.add("ShaderNodeRGB")
        node.outputs[0].default_value = (*rgb, 1.0)
        return node.outputs[0]

    def feed_alike(self, target: Any, other: Any) -> None:
        """Copy the link or the value of another input to an input."""
        if other.is_linked:
            self.link(other.links[0].from_socket, target)
        else:
            target.default_value = other.default_value

    def multiplied(self, output: Any, rgb: Any) -> Any:
        if tuple(rgb) == (1.0, 1.0, 1.0):
            return output
        return self._vector("MULTIPLY", output, rgb)

    def tinted(self, base: Any, share: float) -> Any:
        """Return a tint: white for a share of 0, the hue of ``base`` at luminance 1 for a share of 1."""
        if share <= 0:
            return self.color((1.0, 1.0, 1.0))
        gray = self.add("ShaderNodeRGBToBW")
        self.link(base, gray.inputs[0])
        hue = self._vector("DIVIDE", base, gray.outputs[0])
        return self._vector("MULTIPLY_ADD", hue, (share,) * 3, (1 - share,) * 3)

    def smoothstep(self, low: float, high: float, value: Any) -> Any:
        """Return a smooth step from 0 below ``low`` to 1 above ``high``."""
        node = self.add("ShaderNodeMapRange")
        node.interpolation_type = "SMOOTHSTEP"
        self._feed(node, (value, low, high, 0.0, 1.0))
        return node.outputs[0]

    def between(self, first: Any, second: Any, share: Any) -> Any:
        """Return the linear blend ``first`` · (1 − share) + ``second`` · share."""
        return self.math("MULTIPLY_ADD", self.math("SUBTRACT", second, first), share, first)

    def blended(self, first: Any, second: Any, share: Any) -> Any:
        """Return the linear blend of two colours."""
        kept = self.scaled(first, self.math("SUBTRACT", 1.0, share))
        return self._vector("ADD", kept, self.scaled(second, share))

    def scaled(self, vector: Any, factor: Any) -> Any:
        """Return a vector or a colour times a number."""
        node = self.add("ShaderNodeVectorMath")
        node.operation = "SCALE"
        self.link(vector, node.inputs[0])
        self.link(factor, node.inputs["Scale"])
        return node.outputs[0]

    def mixed(self, share: Any, first: Any, second: Any) -> Any:
        """Return a mix of two shaders; ``share``, a number or an output, is the second's."""
        mix = self.add("ShaderNodeMixShader")
        if isinstance(share, float):
            mix.inputs[0].default_value = share
        else:
            self.link(share, mix.inputs[0])
        self.link(first, mix.inputs[1])
        self.link(second, mix.inputs[2])
        return mix.outputs[0]

    def math(self, operation: str, *operands: Any) -> Any:
        """Return the result of a mathematical operation on outputs and numbers."""
        node = self.add("ShaderNodeMath")
        node.operation = operation
        self._feed(node, operands)
        return node.outputs[0]

    def dot(self, vector: Any, direction: Any) -> Any:
        return self._vector_math("DOT_PRODUCT", vector, tuple(direction)).outputs["Value"]

    def _vector(self, operation: str, *operands: Any) -> Any:
        return self._vector_math(operation, *operands).outputs[0]

    def _vector_math(self, operation: str, *operands: Any) -> Any:
        node = self.add("ShaderNodeVectorMath")
        node.operation = operation
        self._feed(node, operands)
        return node

    def _feed(self, node: Any, operands: Any) -> None:
        for target, operand in zip(node.inputs, operands, strict=False):
            if isinstance(operand, int | float | tuple | list):
                target.default_value = operand
            else:
                self.link(operand, target)


def new_group(data: Any, name: str, inputs: dict[str, str], outputs: dict[str, str]) -> tuple[Any, Nodes, Any, Any]:
    """Return a new node group, its nodes, and the sockets that it gets and gives; ``inputs`` and ``outputs`` are name to kind."""
    group = data.node_groups.new(name, "ShaderNodeTree")
    for way, sockets in (("INPUT", inputs), ("OUTPUT", outputs)):
        for socket, kind in sockets.items():
            group.interface.new_socket(socket, in_out=way, socket_type=f"NodeSocket{kind}")
    nodes = Nodes(group)
    return group, nodes, nodes.add("NodeGroupInput").outputs, nodes.add("NodeGroupOutput").inputs
