# SPDX-License-Identifier: Apache-2.0
"""The parts that water, leaves and snow on surfaces share as Blender's shader nodes."""

from __future__ import annotations

from typing import Any

from .nodes import Nodes, new_group
from .terms import Grain, Term

#: What a cover changes of a surface.
CHANGED = ("Base Color", "Roughness", "Specular IOR Level", "Metallic", "Normal")
_KINDS = dict(zip(CHANGED, ("Color", "Float", "Float", "Float", "Vector"), strict=True))
#: What it reads of the surface without any cover.
DRY = ("Base Color", "Roughness")


class Cover:
    """The node group of what lies on a surface: terms of the surface, and of the cover's amount.

    Args:
        own: name of a further socket, which materials set from their headers.
    """

    def __init__(self, data: Any, name: str, own: str) -> None:
        dry = {f"Dry {changed}": _KINDS[changed] for changed in DRY}
        self.tree, nodes, source, self._result = new_group(data, name, {**_KINDS, **dry, own: "Float"}, _KINDS)
        self.nodes: Nodes = nodes
        geometry = nodes.add("ShaderNodeNewGeometry").outputs
        self.position, self.face = Term(nodes, geometry["Position"]), Term(nodes, geometry["Normal"])
        self.color, self.rough, self.specular, self.metallic, self.normal = (
            Term(nodes, source[part]) for part in CHANGED
        )
        self.dry_color, self.dry_rough = (Term(nodes, source[part]) for part in dry)
        self.own_name, self.own = own, Term(nodes, source[own])
        self.amount = Term(nodes, nodes.add("ShaderNodeValue").outputs[0])
        self.grain = Grain(nodes)

    def show(self, amount: float, pixel: float) -> None:
        """Set the amount, and a pixel's size at 1 m, in metres."""
        self.amount.output.default_value = amount
        self.grain.pixel.default_value = pixel

    def change(self, *changed: Term) -> None:
        """Set the surface below the cover: a term for each of `CHANGED`."""
        for name, term in zip(CHANGED, changed, strict=True):
            self.nodes.link(term.output, self._result[name])
