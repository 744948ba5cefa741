"""Units that were drawn at random, and the estimand that follows from them.

An interval bounds how far an estimate may be from the truth because only some units were drawn. The design determines
the unit:

- A *grid* and *points* list their variants. Nothing was drawn: a grid says nothing about positions between its nodes,
  and a mean over it has a spread but no sampling error. Where such a list is repeated on several sites, each generated
  from a seed, the sites are a sample and a whole site is a unit: every listed variant occurs on each site and adds
  no further observation.
- A *random* design draws its variants from the box that the spec describes; a variant with all its rows (cameras,
  sensors, persons) is a unit.
- *Sobol'*, *Halton* and *Latin hypercube* designs draw their points together, so single points are not independent.
        Replicates of the design are (`valerie.statistics.replicates`).
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Final

import numpy as np
from numpy.typing import NDArray

from valerie.errors import InvalidInput, UnknownName
from valerie.statistics.observations import dense


class Estimand(StrEnum):
    """Subject of an estimate.

    Attributes:
        LISTED_GRID: the mean over exactly the listed variants.
        DESIGN_BOX: the mean over the box of parameters that the design draws from.
        SITES: the mean over the sites of all seeds, at the listed variants.
    """

    LISTED_GRID = "listed_grid"
    DESIGN_BOX = "design_box"
    SITES = "sites"


#: Designs that list their variants.
LISTED: Final = frozenset({"grid", "points"})
#: Designs that draw variants independently of each other.
INDEPENDENT: Final = frozenset({"random"})
#: Designs that draw their variants together, evenly spread.
EVEN: Final = frozenset({"sobol", "halton", "latin_hypercube"})


@dataclass(frozen=True, slots=True, eq=False)
class Units:
    """The sampling units of some rows.

    Attributes:
        estimand: what the units are a sample of.
        index: (N,) int64 unit 0…G−1 of every row.
        count: number G of units.
        replicate: (G,) int64 replicate of each unit, where the design draws units together; else None.
    """

    estimand: Estimand
    index: NDArray[np.int64]
    count: int
    replicate: NDArray[np.int64] | None = None

    def of(self, rows: NDArray[np.bool_]) -> Units:
        """Return the units of the selected ``rows`` ((N,) bool), without units that have no rows left."""
        index, kept = dense(self.index[rows])
        replicate = None if self.replicate is None else self.replicate[kept]
        return Units(self.estimand, index, len(kept), replicate)


def sampling_units(
    design: str,
    variants: NDArray[np.int64],
    *,
    sites: NDArray[np.int64] | None = None,
    replicate: NDArray[np.int64] | None = None,
) -> Units:
    """Return the units that ``design`` drew.

    Args:
        design: ``grid``, ``points``, ``random``, ``sobol``, ``halton`` or ``latin_hypercube``.
        variants: (N,) variant of every row; any integers.
        sites: (N,) site seed of every row; None if the site does not vary.
        replicate: (N,) replicate of every row, for a design whose variants are drawn together; default: one replicate.

    Raises:
        UnknownName: there is no such design.
        InvalidInput: the arrays differ in length, or a variant belongs to two replicates.
    """
    known = LISTED | INDEPENDENT | EVEN
    if design not in known:
        raise UnknownName("design", design, known, field="design")
    for name, labels in (("sites", sites), ("replicate", replicate)):
        if labels is not None and len(labels) != len(variants):
            raise InvalidInput("one label for every row is needed", field=name, value=len(labels), limit=len(variants))
    if design in LISTED:
        if sites is None or len(np.unique(sites)) < 2:
            return _units(Estimand.LISTED_GRID, variants)
        return _units(Estimand.SITES, sites)
    units = _units(Estimand.DESIGN_BOX, variants)
    if design in INDEPENDENT:
        return units
    of_unit = np.zeros(units.count, np.int64)
    if replicate is not None:
        of_unit[units.index] = replicate
        if (of_unit[units.index] != replicate).any():
            raise InvalidInput("a variant belongs to one replicate only", field="replicate")
    return Units(units.estimand, units.index, units.count, of_unit)


def places(positions: NDArray[np.float64], sites: NDArray[np.int64] | None = None) -> Units:
    """Return whole places as units: rows with equal positions of all persons on one site.

    Comparisons are paired within places. Places are no sample of the positions between them, so the estimand is the listed
    grid.

    Args:
        positions: (N, P) coordinates of the persons, metres; equal numbers are equal positions.
        sites: (N,) site seed of every row; None if the site does not vary.
    """
    columns = positions if sites is None else np.column_stack((positions, sites))
    if columns.shape[1] == 0:
        return Units(Estimand.LISTED_GRID, np.zeros(len(columns), np.int64), min(len(columns), 1))
    distinct, index = np.unique(columns, axis=0, return_inverse=True)
    return Units(Estimand.LISTED_GRID, index.ravel().astype(np.int64), len(distinct))


def _units(estimand: Estimand, labels: NDArray[np.int64]) -> Units:
    distinct, index = np.unique(labels, return_inverse=True)
    return Units(estimand, index.ravel().astype(np.int64), len(distinct))
