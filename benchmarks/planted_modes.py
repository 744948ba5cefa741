"""Draw planted scores with distinct failure modes from a seed, for searches.

Ten modes take between 1e-2 and 1e-5 of the cube, each in three to five parameters. Elsewhere scores are rugged and pass.

============ =================================================================================
family       form of a mode
============ =================================================================================
slopes       a ball; scores fall towards it from 2.3 times its radius on
cliffs       a ball; the scores around it do not reveal it
covariates   a ball in two of four covariates and two parameters, with slopes
mixed        one half slopes, one half cliffs
============ =================================================================================

A covariate is a smooth function of three parameters that costs nothing to compute, such as a distance. `Planted.covariates`
returns their quantiles. One score in 200 fails by chance, independently in each repeat.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final
from zlib import crc32

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, gamma

Floats = NDArray[np.float64]

FAMILIES: Final = ("slopes", "cliffs", "mixed", "covariates")
AT_LEAST: Final = 0.5
VOLUMES: Final = tuple(float(volume) for volume in np.geomspace(1e-2, 1e-5, 10))
CHANCE: Final = 1 / 200
_SLOPE: Final = 1.5
_COVARIATES: Final = 4


@dataclass(frozen=True)
class _Mode:
    active: NDArray[np.int64]
    centre: Floats
    radius: float
    cliff: bool


class Planted:
    """A planted score with modes.

    Args:
        family: one of `FAMILIES`.
        seed: seed of all random numbers.

    Attributes:
        family: see above.
        dimensions: number of the cube's dimensions, 6 to 12.
    """

    def __init__(self, family: str, seed: int) -> None:
        rng = np.random.default_rng([seed, crc32(family.encode())])
        self.dimensions = int(rng.integers(6, 13))
        self.family = family
        self._waves = rng.normal(size=(4, self.dimensions)) * 3
        self._phases = rng.random(4) * 2 * np.pi
        self._seed = seed
        self._mixing = np.array([rng.choice(self.dimensions, 3, replace=False) for _ in range(_COVARIATES)])
        self._turns = rng.random((_COVARIATES, 3)) * 2 + 0.5
        reference = rng.random((2**16, self.dimensions))
        self._sorted = np.sort(self._raw(reference), axis=0)
        self._hidden = family == "covariates"
        self._modes = []
        for number, volume in enumerate(VOLUMES):
            if self._hidden:
                parameters = rng.choice(self.dimensions, 2, replace=False)
                active = np.concatenate([parameters, self.dimensions + rng.choice(_COVARIATES, 2, replace=False)])
            else:
                active = rng.choice(self.dimensions, rng.integers(3, 6), replace=False)
            count = len(active)
            radius = (volume * gamma(count / 2 + 1) / np.pi ** (count / 2)) ** (1 / count)
            centre = rng.uniform(radius, 1 - radius, count)
            cliff = family == "cliffs" or (family == "mixed" and number % 2 == 1)
            self._modes.append(_Mode(active, centre, float(radius), cliff))

    def covariates(self, points: Floats) -> Floats:
        """Return the covariates, (n, 4) quantiles."""
        raw = self._raw(points)
        return np.column_stack(
            [np.searchsorted(self._sorted[:, i], raw[:, i]) / len(self._sorted) for i in range(_COVARIATES)]
        )

    def _raw(self, points: Floats) -> Floats:
        return np.asarray((np.sin(self._turns * points[:, self._mixing] * np.pi)).sum(axis=2))

    def _distances(self, points: Floats) -> Floats:
        """Return (n, modes) distances in radii."""
        space = np.column_stack([points, self.covariates(points)]) if self._hidden else points
        return np.column_stack(
            [np.sqrt(((space[:, mode.active] - mode.centre) ** 2).sum(axis=1)) / mode.radius for mode in self._modes]
        )

    def modes(self, points: Floats) -> NDArray[np.bool_]:
        """Return a mask, (n, modes) bool, of the modes that contain each point."""
        return self._distances(points) < 1

    def score(self, points: Floats, repeat: int = 0) -> Floats:
        """Return (n,) scores; chance failures depend on ``repeat``."""
        rugged = np.cos(points @ self._waves.T + self._phases).mean(axis=1)
        margin = 2.0 + 1.2 * rugged
        for mode, distance in zip(self._modes, self._distances(points).T, strict=True):
            margin = np.where(distance < 1, -0.5, margin) if mode.cliff else np.minimum(margin, _SLOPE * (distance - 1))
        chance = np.array([crc32(point.tobytes(), self._seed + 7919 * repeat) for point in points]) / 2**32
        return np.asarray(np.where(chance < CHANCE, 0.1, expit(margin)))
