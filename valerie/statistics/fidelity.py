"""Instance-level fidelity: agreement about which persons are missed, of two engines or of real and rendered pictures.

Equal rates of misses can hide that other persons are missed (Cheng, Stöckel and Zhao 2024, arXiv:2402.07031).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from valerie.errors import InvalidInput
from valerie.statistics.intervals import Interval, mean_interval
from valerie.statistics.units import Estimand, Units


@dataclass(frozen=True, slots=True)
class Fidelity:
    """Numbers of persons by the sides that miss them.

    Attributes:
        both, only_here, only_there, neither: numbers of persons; a person counts once in each frame.
        low, high: 95 % interval of the share on which the sides agree, by sampling unit; None if the design allows none.
        estimand: what the share is over.
    """

    both: int
    only_here: int
    only_there: int
    neither: int
    low: float | None
    high: float | None
    estimand: Estimand

    @property
    def persons(self) -> int:
        """Number of compared persons."""
        return self.both + self.only_here + self.only_there + self.neither

    @property
    def share(self) -> float:
        """Share of the persons that both sides miss or both see."""
        return (self.both + self.neither) / self.persons

    @property
    def missed_here(self) -> int:
        """Number of persons missed here, also there or not."""
        return self.both + self.only_here

    @property
    def kappa(self) -> float | None:
        """Cohen's κ: the agreement beyond chance, 1 at most and 0 for independent misses; None if chance is certain.

        Source: Cohen 1960, doi:10.1177/001316446002000104.
        """
        here, there = self.missed_here, self.both + self.only_there
        total = self.persons
        chance = (here * there + (total - here) * (total - there)) / total**2
        return (self.share - chance) / (1 - chance) if chance < 1 else None


def instance_fidelity(missed_here: NDArray[np.bool_], missed_there: NDArray[np.bool_], units: Units) -> Fidelity:
    """Count on which persons two sides agree.

    Args:
        missed_here, missed_there: (N,) the same persons, missed by each side; at least one.
        units: the sampling units of the rows.

    Raises:
        InvalidInput: no person, or numbers of persons that differ.
    """
    if not len(missed_here) or len(missed_here) != len(missed_there):
        value = (len(missed_here), len(missed_there))
        raise InvalidInput(
            "each person needs both sides", field="missed", value=value, limit="equal numbers, at least 1"
        )
    interval = mean_interval(missed_here == missed_there, units)
    low, high = (interval.low, interval.high) if isinstance(interval, Interval) else (None, None)
    return Fidelity(
        both=int(np.count_nonzero(missed_here & missed_there)),
        only_here=int(np.count_nonzero(missed_here & ~missed_there)),
        only_there=int(np.count_nonzero(~missed_here & missed_there)),
        neither=int(np.count_nonzero(~missed_here & ~missed_there)),
        low=low,
        high=high,
        estimand=units.estimand,
    )
