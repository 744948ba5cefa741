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

    def image(self, image: Any, at: Any = None, *, closest: bool = False) -> Any:
        """Return the outputs of an image, Color and Alpha, at texture coordinates ``at``, by default those of the mesh.

        With ``closest``, they are a pixel's own values, without those around it.
        """
        node = self.add("ShaderNodeTexImage")
        node.image = image
        if closest:
            node.interpolation = "Closest"
        if at is not None:
            self.link(at, node.inputs["Vector"])
        return node.outputs

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
        self.feed(node, (value, low, high, 0.0, 1.0))
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
        self.feed(node, operands)
        return node.outputs[0]

    def calculated(self, operation: str, *operands: Any) -> Any:
        """Return the result of an operation on outputs, numbers and tuples, which is a vector if any operand is one."""
        kinds = {getattr(operand, "type", "VECTOR" if isinstance(operand, tuple) else "VALUE") for operand in operands}
        if kinds == {"VALUE"}:
            return self.math(operation, *operands)
        return self._vector(
            operation, *(o if hasattr(o, "type") or isinstance(o, tuple) else (o,) * 3 for o in operands)
        )

    def dot(self, vector: Any, direction: Any) -> Any:
        return self._vector_math("DOT_PRODUCT", vector, direction).outputs["Value"]

    def _vector(self, operation: str, *operands: Any) -> Any:
        return self._vector_math(operation, *operands).outputs[0]

    def _vector_math(self, operation: str, *operands: Any) -> Any:
        node = self.add("ShaderNodeVectorMath")
        node.operation = operation
        self.feed(node, operands)
        return node

    def feed(self, node: Any, operands: Any) -> None:
        """Link outputs to a node's inputs, or set their values, in the order of the inputs."""
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
