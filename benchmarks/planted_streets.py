"""Draw planted scores that look like renders: mixed parameters, jumps where a person is hidden, and noise.

============ =========================================================================================================
family       score
============ =========================================================================================================
street       falls with distance, depends on heading and outfit; jumps in two shadows and a wedge behind something
*junction*   depends on pairs of outfit and light; jumps in three boxes; noise grows with distance
*flicker*    no jumps; noise large enough to turn many verdicts
============ =========================================================================================================

Between 5 and 30 % fail. Noise follows from the point, so a repetition gives the same score. The last two were drawn up before
maps were chosen, and must not be used to choose any constant.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final
from zlib import crc32

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, ndtri

from valerie.guided.domain import Domain
from valerie.parameters.blocks import Variation
from valerie.parameters.definitions import ParameterDefinition
from valerie.parameters.distributions import Choice, Uniform
from valerie.plain import JsonObject

Floats = NDArray[np.float64]

_TRUTH_POINTS: Final = 2**15


@dataclass(frozen=True, slots=True)
class PlantedStreet:
    """A planted score below 0.5 in a share of its domain.

    Attributes:
        domain: two places, a heading, one or two choices, and a number or two.
        score: (n, dimensions) points to (n,) scores in 0…1.
    """

    domain: Domain
    score: Callable[[Floats], Floats]


def plant(family: str, seed: int) -> PlantedStreet:
    """Return the score of a family, which follows from the seed."""
    rng = np.random.default_rng([seed, crc32(family.encode())])
    choices = (3, 5) if family == "junction" else (4,)
    load = LOADS[family](rng, choices)

    def noisy(points: Floats) -> Floats:
        return load(points, np.array([ndtri((crc32(point.tobytes(), seed) + 0.5) / 2**32) for point in points]))

    domain = _domain(choices)
    loads = noisy(np.random.default_rng([seed, 1, 1]).random((_TRUTH_POINTS, domain.dimensions)))
    bound, scale = np.quantile(loads, 1 - rng.uniform(0.05, 0.3)), 3 / loads.std()
    return PlantedStreet(domain, lambda points: np.asarray(expit(scale * (bound - noisy(points)))))


def _domain(choices: tuple[int, ...]) -> Domain:
    numbers = {"x": "FLOAT", "y": "FLOAT", "heading": "ANGLE", "light": "FLOAT"}
    documents: list[JsonObject] = [
        {"path": f"scene.{name}", "type": kind, "minimum": 0, "maximum": 360 if kind == "ANGLE" else 1, "default": 0}
        for name, kind in numbers.items()
    ]
    for number, count in enumerate(choices):
        values = [f"value-{value}" for value in range(count)]
        documents.append(
            {"path": f"scene.choice-{number}", "type": "CATEGORICAL", "choices": values, "default": "value-0"}
        )
    definitions = [ParameterDefinition.model_validate({**document, "affects": "geometry"}) for document in documents]
    return Domain(
        definitions,
        [Variation(d.path, Choice(values=d.choices) if d.choices else Uniform()) for d in definitions],
    )


def _chosen(quantiles: Floats, count: int) -> NDArray[np.int64]:
    return np.minimum((quantiles * count).astype(np.int64), count - 1)


_Load = Callable[[Floats, Floats], Floats]


def _street(rng: np.random.Generator, choices: tuple[int, ...]) -> _Load:
    outfits, phase = rng.normal(size=choices[0]), rng.random()
    far, turned, dark = rng.uniform(1, 4), rng.uniform(0, 1), rng.normal(scale=0.5)
    shadows, ways, edges = rng.random((2, 2)), rng.normal(size=2), rng.uniform(0.1, 0.6, 2)

    def load(points: Floats, noise: Floats) -> Floats:
        x, y, heading, light = points.T[:4]
        shaded = (((points[:, None, :2] - shadows) ** 2).sum(axis=2) < edges**2 / 9).any(axis=1)
        hidden = np.abs((x - 0.5) * ways[0] + (y - edges[0]) * ways[1]) < 0.06
        smooth = far * y**2 + turned * np.cos(2 * np.pi * (heading - phase)) + dark * light
        return np.asarray(smooth + outfits[_chosen(points[:, 4], choices[0])] + 1.5 * shaded + 3 * hidden + 0.5 * noise)

    return load


def _junction(rng: np.random.Generator, choices: tuple[int, ...]) -> _Load:
    pairs = rng.normal(size=choices)
    low, sides, heights = rng.random((3, 2)) * 0.7, rng.uniform(0.1, 0.4, (3, 2)), rng.uniform(1, 4, 3)
    phase, pull = rng.random(), rng.normal(size=2)

    def load(points: Floats, noise: Floats) -> Floats:
        x, y, heading, light = points.T[:4]
        place = points[:, None, :2]
        boxes = ((place > low) & (place < low + sides)).all(axis=2) @ heights
        outfit, scene = _chosen(points[:, 4], choices[0]), _chosen(points[:, 5], choices[1])
        facing = np.where(((heading - phase) % 1) < 0.4, 0.8, 0.0)
        smooth = pull[0] * x + np.exp(1.2 * y) + pull[1] * (light - 0.5) * y
        return np.asarray(smooth + boxes + facing + pairs[outfit, scene] + (0.2 + 0.6 * y) * noise)

    return load


def _flicker(rng: np.random.Generator, choices: tuple[int, ...]) -> _Load:
    weights, bend, outfits, phase = rng.normal(size=3), rng.normal(size=3), rng.normal(size=choices[0]), rng.random()

    def load(points: Floats, noise: Floats) -> Floats:
        numbers = points[:, [0, 1, 3]] - 0.5
        smooth = 2 * numbers @ weights + (2 * numbers @ bend) ** 2 + np.sin(2 * np.pi * (points[:, 2] - phase))
        return np.asarray(smooth + 0.5 * outfits[_chosen(points[:, 4], choices[0])] + 1.2 * noise)

    return load


LOADS: Final[dict[str, Callable[[np.random.Generator, tuple[int, ...]], _Load]]] = {
    "street": _street,
    "junction": _junction,
    "flicker": _flicker,
}
