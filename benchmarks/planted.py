"""Draw planted data: scores of persons with a known true mean, for every design that a run can have.

A *world* is a function of six numbers in [0, 1) with values in [0, 1]: a network's score as if the numbers were the
street, the place, the light and the camera. A *design* states how often each of the six is drawn:

================ ==================================================== ==================================
design           the six numbers                                      the truth is the mean over
================ ==================================================== ==================================
independent      all drawn for each unit                              the box
clustered        0–3 drawn for each unit, 4–5 for each of its rows    the box
crossed grid     0–2 drawn for each street, 5 for each of its rows,   streets, at the eight listed nodes
                 3 × 4 on a listed grid of 4 × 2
sobol            all by scrambled Sobol' points, in replicates        the box
latin hypercube  all by Latin hypercubes, in replicates               the box
================ ==================================================== ==================================

Worlds come in two families. Methods are chosen on ``TUNING`` and reported on ``REPORTED``. No world is in both families, and
their shapes differ (uniform against normal effects, corners against balls), so that methods are not tuned to the reported ones.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, ndtri
from scipy.stats import qmc

Floats = NDArray[np.float64]
#: (…, 6) numbers in [0, 1) to (…) scores in [0, 1].
World = Callable[[Floats], Floats]

DIMENSIONS: Final = 6
DESIGNS: Final = ("independent", "clustered", "crossed grid", "sobol", "latin hypercube")
#: Listed values of numbers 3 and 4 in the crossed grid: four places and two suns.
NODES: Final = (np.array([0.2, 0.4, 0.6, 0.8]), np.array([0.25, 0.75]))
#: Largest number of rows of a unit in the clustered design; the smallest is 2.
MOST_ROWS: Final = 8
#: log2 of the number of points for a truth, in each of `_TRUTH_SCRAMBLES` scrambles.
_TRUTH_POINTS: Final = 16
_TRUTH_SCRAMBLES: Final = 8


@dataclass(frozen=True, slots=True)
class Draws:
    """Data of many repetitions of one experiment.

    Attributes:
        values: (repetitions, units, rows) scores in [0, 1].
        weights: (repetitions, units, rows) weight of each row; 0 where there is no row.
        replicate: (units,) int64 replicate of each unit; None for a design without replicates.
    """

    values: Floats
    weights: Floats
    replicate: NDArray[np.int64] | None = None


def _mild(u: Floats) -> Floats:
    """Return scores spread over the middle: few are within a tenth of 0 or 1."""
    far = 0.5 * u[..., 0] ** 2 * (0.6 + 0.4 * u[..., 1])
    dark = 0.35 * (u[..., 2] > 0.4) * np.sqrt(u[..., 3])
    return np.asarray(0.99 - far - dark - 0.07 * u[..., 4] ** 2 - 0.07 * u[..., 5])


def _piled(u: Floats) -> Floats:
    """Return scores that are mostly exactly 0 or exactly 1."""
    margin = 1.1 - u[..., 0] - 0.7 * u[..., 1] * u[..., 2] + 0.4 * np.cos(2 * np.pi * u[..., 3])
    return np.asarray(np.clip(3 * (margin - 0.25 * u[..., 4] - 0.3 * u[..., 5]), 0, 1))


def _rare(u: Floats) -> Floats:
    """Return scores near 1, except on one side of a curved boundary that cuts off 5 % of the box."""
    beyond = u[..., 1] + u[..., 0] * u[..., 2] + 0.1 * u[..., 5] > 1.42
    return np.asarray(np.where(beyond, 0.5 * u[..., 3] * u[..., 4], 1 - 0.04 * u[..., 3] * u[..., 5]))


def _waves_tuning(u: Floats) -> Floats:
    """Return scores spread over the middle: none is 0 or 1."""
    c = 2 * u - 1
    effects = 1.2 * c[..., 0] + 0.8 * np.sin(2 * np.pi * u[..., 1]) + 1.2 * c[..., 2] * c[..., 3]
    return np.asarray(expit(0.6 + effects + 0.6 * c[..., 4] + 0.8 * c[..., 5]))


def _ramp_tuning(u: Floats) -> Floats:
    """Return scores: four in nine are exactly 1, a third exactly 0."""
    c = 2 * u - 1
    effects = c[..., 0] + 0.8 * c[..., 1] + 0.7 * np.sin(2 * np.pi * u[..., 2]) + 0.6 * c[..., 3]
    return np.asarray(np.clip(0.75 + 1.6 * (effects + 0.3 * c[..., 4] + 0.5 * c[..., 5]), 0, 1))


def _corner_tuning(u: Floats) -> Floats:
    """Return scores near 1, except in a corner with 5 % of the box."""
    corner = (u[..., 0] > 0.7) & (u[..., 1] < 0.46) & (u[..., 2] > 0.54) & (u[..., 5] < 0.8)
    return np.asarray(np.where(corner, 0.4 * u[..., 3], 1 - 0.05 * u[..., 4] ** 2))


def _mild_tuning(u: Floats) -> Floats:
    z = ndtri(0.002 + 0.996 * u)
    effects = 0.6 * z[..., 0] + 0.4 * z[..., 1] * z[..., 2] + 0.4 * z[..., 3]
    return np.asarray(expit(0.9 + effects + 0.3 * z[..., 4] + 0.4 * z[..., 5]))


def _skewed_tuning(u: Floats) -> Floats:
    return np.asarray(1 - 0.8 * u[..., 0] ** 3 * (0.4 + 0.6 * u[..., 1]) * (0.5 + 0.5 * u[..., 5]) - 0.15 * u[..., 3])


def _outliers_tuning(u: Floats) -> Floats:
    """Return similar scores away from both ends, except for 5 % at 0."""
    return np.asarray(np.where(np.abs(u[..., 1] - 0.4) < 0.025, 0.0, 0.75 + 0.2 * u[..., 0] * u[..., 4]))


def _piled_tuning(u: Floats) -> Floats:
    radius = ((u[..., :4] - 0.5) ** 2).sum(axis=-1) + 0.1 * (u[..., 4] - 0.5) + 0.1 * (u[..., 5] - 0.5)
    return np.asarray(np.clip(8 * (radius - 0.26), 0, 1))


def _wall_tuning(u: Floats) -> Floats:
    z = ndtri(0.002 + 0.996 * u)
    return np.asarray((z[..., 0] + 0.7 * z[..., 1] - 0.6 * z[..., 3] + 0.5 * z[..., 5] > -0.6).astype(float))


def _rare_tuning(volume: float) -> World:
    """Return a world with two balls in numbers 0–2, together about ``volume`` of the box."""
    radius = (volume * 3 / (8 * np.pi)) ** (1 / 3)

    def world(u: Floats) -> Floats:
        ball = ((u[..., :3] - 0.3) ** 2).sum(axis=-1) < radius**2
        other = ((u[..., :3] - np.array([0.7, 0.65, 0.6])) ** 2).sum(axis=-1) < radius**2
        bad = np.where(u[..., 5] < 0.5, 0.0, 0.6 * u[..., 4])
        return np.asarray(np.where(ball | other, bad, 1 - 0.08 * u[..., 3] * (u[..., 4] > 0.5)))

    return world


REPORTED: Final = MappingProxyType({"mild": _mild, "piled": _piled, "rare": _rare})
TUNING: Final = MappingProxyType(
    {
        "mild": _mild_tuning,
        "waves": _waves_tuning,
        "skewed": _skewed_tuning,
        "outliers": _outliers_tuning,
        "piled": _piled_tuning,
        "ramp": _ramp_tuning,
        "wall": _wall_tuning,
        "rare 2 %": _rare_tuning(0.02),
        "corner": _corner_tuning,
        "rare 8 %": _rare_tuning(0.08),
    }
)


@cache
def passed(world: World, threshold: float = 0.5) -> World:
    """Return the world whose score is 1 if that of ``world`` reaches ``threshold``, else 0: its mean is a share."""
    return lambda u: (world(u) >= threshold).astype(float)


def alike(u: Floats) -> Floats:
    """Return equal weights for all rows."""
    return np.ones(u.shape[:-1])


def pixels(u: Floats) -> Floats:
    """Return weights proportional to a person's pixels: up to 20 times as many near the camera as far away."""
    return np.asarray((1 + 3.5 * u[..., 3]) ** -2)


@cache
def truth(world: World, design: str, weigh: World = alike) -> float:
    """Return the true weighted mean of ``world`` over the population of ``design``; exact to about 1e-4."""
    means = []
    for seed in range(_TRUTH_SCRAMBLES):
        u = qmc.Sobol(DIMENSIONS, rng=np.random.default_rng(seed)).random_base2(_TRUTH_POINTS)
        if design == "crossed grid":
            u = _on_nodes(u[:, None, :].repeat(8, axis=1))
        means.append(float(np.average(world(u), weights=weigh(u))))
    return float(np.mean(means))


def draw(
    world: World,
    design: str,
    *,
    units: int,
    repetitions: int,
    seed: int,
    replicates: NDArray[np.int64] | None = None,
    weigh: World = alike,
) -> Draws:
    """Draw data of ``world`` by ``design``.

    Args:
        world: one of `REPORTED` or `TUNING`.
        design: one of `DESIGNS`.
        units: number of units in each repetition.
        repetitions: number of experiments.
        seed: seed of all random numbers.
        replicates: (units,) replicate of each unit, for the last two designs; by default, all units are in one replicate.
        weigh: returns the weight of each row.
    """
    rng = np.random.default_rng(seed)
    if design in {"sobol", "latin hypercube"}:
        replicate = np.zeros(units, np.int64) if replicates is None else replicates
        points = _sobol if design == "sobol" else _latin_hypercube
        sizes = np.bincount(replicate)
        u = np.concatenate([points(rng, repetitions, int(size)) for size in sizes], axis=1)[:, :, None, :]
        return Draws(world(u), weigh(u), np.sort(replicate))
    if design == "independent":
        u = rng.random((repetitions, units, 1, DIMENSIONS))
        return Draws(world(u), weigh(u))
    if design == "clustered":
        u = np.repeat(rng.random((repetitions, units, 1, DIMENSIONS)), MOST_ROWS, axis=2)
        u[..., 4:] = rng.random((*u.shape[:3], 2))
        # Units differ in size, which does not affect the score.
        sizes = rng.integers(2, MOST_ROWS + 1, (repetitions, units, 1))
        return Draws(world(u), weigh(u) * (np.arange(MOST_ROWS) < sizes))
    u = _on_nodes(np.repeat(rng.random((repetitions, units, 1, DIMENSIONS)), 8, axis=2))
    # This number differs from picture to picture within a street.
    u[..., 5] = rng.random(u.shape[:3])
    return Draws(world(u), weigh(u))


def _on_nodes(u: Floats) -> Floats:
    """Set numbers 3 and 4 of (…, 8, 6) to the listed nodes."""
    place, sun = np.meshgrid(*NODES, indexing="ij")
    u[..., 3], u[..., 4] = place.ravel(), sun.ravel()
    return u


@cache
def _sobol_bits(size: int) -> NDArray[np.uint32]:
    """Return (size, dimensions): the first Sobol' points, unscrambled, as 30-bit integers."""
    engine = qmc.Sobol(DIMENSIONS, scramble=False)
    base = engine.random_base2(max(size - 1, 0).bit_length())[:size]
    return np.asarray(base * 2**30, np.uint32)


def _sobol(rng: np.random.Generator, repetitions: int, size: int) -> Floats:
    """Return (repetitions, size, dimensions): independent scrambles like scipy's, all at once.

    Linear matrix scramble and digital shift (Matoušek 1998, doi:10.1006/jcom.1998.0489): the first ``size`` points have
    few binary digits, so that only these digits' columns of the random matrix are drawn.
    """
    base = _sobol_bits(size)
    shape = (repetitions, 1, DIMENSIONS)
    scrambled = rng.integers(0, 2**30, shape, dtype=np.uint32) ^ np.zeros((1, size, 1), np.uint32)
    for digit in range(max(size - 1, 0).bit_length()):
        place = 29 - digit
        column = np.uint32(1 << place) | rng.integers(0, 1 << place, shape, dtype=np.uint32)
        scrambled ^= ((base >> np.uint32(place)) & np.uint32(1)) * column
    return (scrambled + 0.5) / 2**30


def _latin_hypercube(rng: np.random.Generator, repetitions: int, size: int) -> Floats:
    """Return (repetitions, size, dimensions): one point in each of ``size`` strata of every dimension."""
    strata = rng.random((repetitions, size, DIMENSIONS)).argsort(axis=1)
    return np.asarray((strata + rng.random(strata.shape)) / size)
