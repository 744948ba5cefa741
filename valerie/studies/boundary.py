"""A picture of a map: pass and fail over the two parameters that matter most."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import groupby
from typing import Final

import numpy as np

from valerie.guided.domain import Domain
from valerie.guided.map import Call, Map
from valerie.parameters.samplers import UnitPoints

#: Cells of a side.
CELLS: Final = 32
#: Text of a cell whose variant is illegal.
ILLEGAL: Final = "does not occur"
_COMPARED: Final = 256


@dataclass(frozen=True, slots=True)
class BoundarySlice:
    """A section of the map over two parameters; the others stay as in one variant.

    Attributes:
        names: names of the parameters across and up.
        ends: for each of them, the values at both ends, as text. The scale between them is in quantiles.
        strips: (row from the top, first column, number of columns, call) of equal cells; calls are those of
            `valerie.guided.map.Call`, or `ILLEGAL`.
        anchor: values of the other parameters, by name, as text.
    """

    names: tuple[str, str]
    ends: tuple[tuple[str, str], tuple[str, str]]
    strips: tuple[tuple[int, int, int, str], ...]
    anchor: dict[str, str]

    @property
    def calls(self) -> tuple[str, ...]:
        """The calls that occur, in the order of a legend."""
        present = {call for *_, call in self.strips}
        return tuple(call for call in (*map(str, Call), ILLEGAL) if call in present)


def slice_of(boundary: Map, domain: Domain, anchor: UnitPoints) -> BoundarySlice | None:
    """Return the slice through a point.

    The two parameters are those that change the most calls: the share of operational points whose call changes when only
    this parameter is drawn again.

    Args:
        boundary: the map.
        domain: its operational domain.
        anchor: (dimensions,) the point.

    Returns:
        The slice; None for a domain of one parameter.
    """
    if domain.dimensions < 2:
        return None
    rng = np.random.default_rng(0)
    drawn, other = domain.draw(rng, _COMPARED), domain.draw(rng, _COMPARED)
    changed = [np.where(np.arange(domain.dimensions) == i, other, drawn) for i in range(domain.dimensions)]
    calls = boundary.calls(np.concatenate([drawn, *changed])).reshape(-1, _COMPARED)
    across, up = np.argsort(-(calls[1:] != calls[0]).mean(axis=1), kind="stable")[:2].tolist()
    middles = (np.arange(CELLS) + 0.5) / CELLS
    points = np.tile(anchor, (CELLS * CELLS, 1))
    points[:, across], points[:, up] = np.tile(middles, CELLS), np.repeat(middles[::-1], CELLS)
    cells = np.where(domain.legal(points), boundary.calls(points).astype("<U14"), ILLEGAL).reshape(CELLS, CELLS)
    strips = []
    for row, texts in enumerate(cells.tolist()):
        column = 0
        for call, members in groupby(texts):
            width = len(list(members))
            strips.append((row, column, width, call))
            column += width
    low, high, kept = (
        [d.text(value, 4) for value, d in zip(domain.values(point).values(), domain.definitions, strict=True)]
        for point in (np.zeros(domain.dimensions), np.ones(domain.dimensions), anchor)
    )
    return BoundarySlice(
        names=(domain.names[across], domain.names[up]),
        ends=((low[across], high[across]), (low[up], high[up])),
        strips=tuple(strips),
        anchor={name: kept[i] for i, name in enumerate(domain.names) if i not in (across, up)},
    )
