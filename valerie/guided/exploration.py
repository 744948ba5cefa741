"""Points that fill the operational domain evenly."""

from __future__ import annotations

from typing import Final

import numpy as np

from valerie.errors import InvalidInput
from valerie.guided.domain import LEAST_LEGAL, Cube
from valerie.parameters.samplers import UnitPoints

#: Points drawn at a time, a power of 2.
_BLOCK: Final = 64


class SpaceFilling:
    """The legal points of a scrambled Sobol' sequence (Owen 1998, doi:10.1006/jcom.1998.0487), in order.

    Args:
        domain: the operational domain.
        seed: of the scrambling.
    """

    def __init__(self, domain: Cube, seed: int) -> None:
        from scipy.stats import qmc

        self._domain = domain
        self._sobol = qmc.Sobol(domain.dimensions, rng=np.random.default_rng([seed, 0]))
        self._left = np.empty((0, domain.dimensions))
        self._drawn = self._legal = 0

    def take(self, count: int) -> UnitPoints:
        """Return the next points, (count, dimensions).

        Raises:
            InvalidInput: less than `LEAST_LEGAL` of the domain is legal.
        """
        blocks = [self._left]
        missing = count - len(self._left)
        while missing > 0:
            points = np.minimum(self._sobol.random(_BLOCK), np.nextafter(1.0, 0.0))
            blocks.append(points[self._domain.legal(points)])
            missing -= len(blocks[-1])
            self._drawn += _BLOCK
            self._legal += len(blocks[-1])
            if self._drawn * LEAST_LEGAL > self._legal + 1:
                raise InvalidInput(
                    "hardly any variant is legal",
                    field="vary",
                    value=f"{self._legal} of {self._drawn:,}",
                    limit=LEAST_LEGAL,
                )
        points = np.concatenate(blocks)
        self._left = points[count:]
        return points[:count]
