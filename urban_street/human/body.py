"""The shape of a body: MakeHuman's macro sliders and detail targets, applied to the base mesh."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import product

import numpy as np
from numpy.typing import NDArray

from urban_street.human import data
from valerie.errors import InvalidInput
from valerie.scene.graph.model import freeze


@dataclass(frozen=True, slots=True)
class BodyShape:
    """Sliders in [0, 1], as in MakeHuman; 0.5 is the average.

    Attributes:
        sex: 0 female … 1 male.
        age: 0 new-born, 0.1875 about 12 years, 0.5 about 25 years, 1 about 90 years.
        muscle, weight, height: build of the grown body.
        proportions: 0 uncommon … 1 ideal.
        ancestry: weights of ``african``, ``asian``, ``caucasian``, summing to 1.
        details: further targets with their strengths, e.g. ``{"stomach/stomach-tone-incr": 0.4}``.
    """

    sex: float
    age: float = 0.5
    muscle: float = 0.5
    weight: float = 0.5
    height: float = 0.5
    proportions: float = 0.5
    ancestry: Mapping[str, float] = field(default_factory=lambda: {"caucasian": 1.0})
    details: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in ("sex", "age", "muscle", "weight", "height", "proportions"):
            value = getattr(self, name)
            if not 0.0 <= value <= 1.0:
                raise InvalidInput("body slider out of range", field=name, value=value, limit="0…1")


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """A shaped body in the rest pose (arms about 45° down), with its joints.

    Attributes:
        vertices: (19158, 3) float64, metres, z up, facing +y, the character's left at −x.
        heads, tails: (bones, 3) float64, metres, the two ends of each bone of `data.rig`.
    """

    vertices: NDArray[np.float64]
    heads: NDArray[np.float64]
    tails: NDArray[np.float64]

    def head(self, bone: str) -> NDArray[np.float64]:
        """Return the joint at which the bone begins, (3,)."""
        joint: NDArray[np.float64] = self.heads[data.rig().bones.index(bone)]
        return joint

    def tail(self, bone: str) -> NDArray[np.float64]:
        """Return the end of the bone, (3,)."""
        end: NDArray[np.float64] = self.tails[data.rig().bones.index(bone)]
        return end


def shape_body(shape: BodyShape) -> Body:
    """Apply the macro and detail targets of ``shape`` to the base mesh and place the joints."""
    vertices = data.base_mesh().vertices.copy()
    for name, strength in _targets(shape):
        vertices += strength * data.target(name)
    rig = data.rig()
    return Body(
        vertices=freeze(vertices),
        heads=freeze(np.array([vertices[rows].mean(axis=0) for rows in rig.head_vertices])),
        tails=freeze(np.array([vertices[rows].mean(axis=0) for rows in rig.tail_vertices])),
    )


def _targets(shape: BodyShape) -> Iterator[tuple[str, float]]:
    """Yield names and strengths. A macro target has the product of the shares of the words in its name."""
    sex = {"female": 1.0 - shape.sex, "male": shape.sex}
    age = _age_shares(shape.age)
    muscle = _tent(shape.muscle, ("minmuscle", "averagemuscle", "maxmuscle"))
    weight = _tent(shape.weight, ("minweight", "averageweight", "maxweight"))
    height = _tent(shape.height, ("minheight", "", "maxheight"))
    proportions = _tent(shape.proportions, ("uncommonproportions", "", "idealproportions"))

    def shares(*tables: Mapping[str, float]) -> Iterator[tuple[tuple[str, ...], float]]:
        for words in product(*tables):
            strength = float(np.prod([table[word] for table, word in zip(tables, words, strict=True)]))
            if strength > 0.0 and all(words):
                yield words, strength

    for words, strength in shares(shape.ancestry, sex, age):
        yield "macrodetails/" + "-".join(words), strength
    for words, strength in shares(sex, age, muscle, weight):
        yield "macrodetails/universal-" + "-".join(words), strength
    for words, strength in shares(sex, age, muscle, weight, height):
        yield "macrodetails/height/" + "-".join(words), strength
    for words, strength in shares(sex, age, muscle, weight, proportions):
        yield "macrodetails/proportions/" + "-".join(words), strength
    yield from sorted(shape.details.items())


def _tent(value: float, names: tuple[str, str, str]) -> dict[str, float]:
    """Return the shares of low, middle and high: linear between them, with the middle at 0.5."""
    low, middle, high = names
    return {low: max(0.0, 1.0 - 2.0 * value), middle: 1.0 - abs(2.0 * value - 1.0), high: max(0.0, 2.0 * value - 1.0)}


def _age_shares(age: float) -> dict[str, float]:
    knots = (0.0, 0.1875, 0.5, 1.0)
    names = ("baby", "child", "young", "old")
    return {name: float(np.interp(age, knots, np.eye(4)[i])) for i, name in enumerate(names)}
