"""The traffic signs of a generated street whose faces can vary. They belong to the background."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from urban_street.signs.faces import PLACED, face_materials, face_textures, faces, plate
from urban_street.street.plan import PEOPLE_Y, Placement, StreetLayout, nearest
from valerie.parameters.declaring import choice
from valerie.parameters.definitions import Affects, ParameterDefinition
from valerie.scene.assets.attributes import ABSENT
from valerie.scene.graph.model import Material, Node, Texture

#: Number of signs with parameters: those nearest to the places of people.
_COUNT: Final = 4


def varied_signs(layout: StreetLayout) -> list[Placement]:
    """Return the signs with a parameter, nearest to the people first."""
    return nearest((placement for placement in layout.placements if placement.kind == "face"), _COUNT, PEOPLE_Y)


def sign_parameters(sign: Placement) -> Iterator[ParameterDefinition]:
    """Yield the parameter of a sign. The default is what the layout places there."""
    own = PLACED[sign.variant]
    yield choice(f"{sign.path}.face", (*faces(), ABSENT), own, Affects.GEOMETRY, "face of the sign, or absent")


def with_faces(
    nodes: Sequence[Node], signs: Sequence[Placement]
) -> tuple[list[Node], dict[str, Material], dict[str, Texture]]:
    """Return the nodes, with all faces below those of ``signs``, only their own visible, and what the faces are made of."""
    if not signs:
        return list(nodes), {}, {}
    own = {sign.path: PLACED[sign.variant] for sign in signs}
    several: list[Node] = []
    for node in nodes:
        if node.path not in own:
            several.append(node)
            continue
        several.append(replace(node, meshes=()))
        several += (
            Node(f"{node.path}.{face}", np.eye(4), plate(face), visible=face == own[node.path]) for face in faces()
        )
    return several, face_materials(), face_textures()
