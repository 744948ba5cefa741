"""Paints of vehicles. An asset names them; the value of a vehicle's colour is one of these names."""

from __future__ import annotations

from typing import Annotated, Final

from pydantic import Field

from valerie.document import Document

#: Prefix of the names of paint materials, after the last ``/``.
PAINT_PREFIX: Final = "paint-"

_Share = Annotated[float, Field(ge=0.0, le=1.0, allow_inf_nan=False)]


class Paint(Document):
    """The look of a paint.

    Attributes:
        base_color: linear RGB reflectance.
        metallic, roughness: see `valerie.scene.graph.model.Material`.
    """

    base_color: tuple[_Share, _Share, _Share]
    metallic: _Share = 0.0
    roughness: _Share = 0.2


def is_paint(material_name: str) -> bool:
    """Return True for a vehicle's paint: the last ``/``-separated part of its name starts with ``paint-``."""
    return material_name.rpartition("/")[2].startswith(PAINT_PREFIX)
