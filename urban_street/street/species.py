"""Kinds of trees: crowns, leaves, bark and colours as tables."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from urban_street.street.plan import Season, StreetSettings
from urban_street.street.wood import TreeSettings

Color = tuple[float, float, float]
Line = tuple[tuple[float, float], ...]

#: Share of the light scattered by a leaf that leaves it on the other side: green leaves transmit nearly as much as they reflect
#: (Jacquemoud and Baret 1990, doi:10.1016/0034-4257(90)90100-Z).
TRANSLUCENCY: Final = 0.45


@dataclass(frozen=True, slots=True)
class Leaf:
    """The leaves of a kind, as drawn on cards (`urban_street.street.textures.sprays`).

    Attributes:
        outline: right half of a leaf of length 1 from its stalk (0, 0) to its tip (0, 1), (across, along).
        length: length of a leaf as a share of the card's side.
        along: number of pairs of leaves along a twig.
        twigs: number of pairs of side twigs.
        leaflets: leaflets that spread from each stalk; 1 for a simple leaf.
        summer, autumn, spring: linear colours that the lit side shows. A kind whose autumn is its summer is evergreen.
        blossoms: True if it carries flowers of the spring's colour before its leaves.
    """

    outline: Line
    length: float
    summer: Color
    autumn: Color
    spring: Color
    along: int = 4
    twigs: int = 3
    leaflets: int = 1
    blossoms: bool = False

    @property
    def evergreen(self) -> bool:
        return self.autumn == self.summer

    def color(self, season: Season) -> Color:
        """Return the linear colour in a season. Bare kinds have none in winter."""
        return {"spring": self.spring, "summer": self.summer, "autumn": self.autumn, "winter": self.summer}[season]


@dataclass(frozen=True, slots=True)
class Species:
    """A kind of tree; lengths in metres.

    Attributes:
        shape: its size and wood, and the number of its cards.
        crown: outline of the crown: shares of its height above the lowest leaf, and of its radius.
        leaf: its leaves.
        bark: texture of the bark, and a factor of its colour.
        hang: direction of twigs: −1 up, 0 outwards, 1 straight down.
        leader: True if the trunk runs up to the top.
        stakes: True if stakes hold it upright.
    """

    shape: TreeSettings
    crown: Line
    leaf: Leaf
    bark: tuple[str, Color] = ("bark", (1.0, 1.0, 1.0))
    hang: float = 0.0
    leader: bool = False
    stakes: bool = False

    @property
    def footing(self) -> float:
        """Return the radius of what stands on the ground, metres: the trunk with its flare, or the stakes."""
        return 0.38 if self.stakes else 1.6 * self.shape.trunk

    def from_afar(self) -> Species:
        """Return the same tree with fewer and larger cards."""
        shape = self.shape
        fewer = replace(
            shape, clusters=round(0.55 * shape.clusters), branches=round(0.7 * shape.branches), leaf=1.32 * shape.leaf
        )
        return replace(self, shape=fewer)


_HEART: Final = (
    (0.0, 0.0),
    (0.16, -0.07),
    (0.36, 0.03),
    (0.45, 0.24),
    (0.40, 0.48),
    (0.24, 0.74),
    (0.06, 0.94),
    (0.0, 1.0),
)
_PALM: Final = (
    (0.0, 0.0), (0.20, -0.10), (0.50, -0.06), (0.36, 0.10), (0.66, 0.36), (0.40, 0.38), (0.52, 0.66), (0.25, 0.56),
    (0.16, 0.80), (0.0, 1.0),
)  # fmt: skip
_LOBED: Final = (
    (0.0, 0.0), (0.06, 0.10), (0.20, 0.17), (0.11, 0.27), (0.30, 0.37), (0.16, 0.48), (0.35, 0.60), (0.20, 0.70),
    (0.25, 0.83), (0.10, 0.93), (0.0, 1.0),
)  # fmt: skip
_OVAL: Final = ((0.0, 0.0), (0.16, 0.10), (0.28, 0.32), (0.29, 0.52), (0.20, 0.78), (0.06, 0.94), (0.0, 1.0))
_RHOMB: Final = ((0.0, 0.0), (0.22, 0.08), (0.40, 0.28), (0.30, 0.50), (0.13, 0.78), (0.0, 1.0))
_LANCE: Final = ((0.0, 0.0), (0.06, 0.14), (0.09, 0.42), (0.06, 0.72), (0.0, 1.0))
_LEAFLET: Final = ((0.0, 0.0), (0.05, 0.18), (0.16, 0.55), (0.19, 0.72), (0.09, 0.90), (0.0, 1.0))
_NEEDLE: Final = ((0.0, 0.0), (0.045, 0.1), (0.045, 0.7), (0.0, 1.0))

_EGG: Final = ((0.0, 0.45), (0.12, 0.80), (0.32, 1.0), (0.60, 0.92), (0.82, 0.64), (1.0, 0.12))
_DOME: Final = ((0.0, 0.62), (0.10, 0.92), (0.30, 1.0), (0.62, 0.94), (0.85, 0.68), (1.0, 0.18))
_SLIM: Final = ((0.0, 0.35), (0.15, 0.80), (0.40, 1.0), (0.70, 0.80), (1.0, 0.10))
_CONE: Final = ((0.0, 0.92), (0.06, 1.0), (0.50, 0.56), (0.85, 0.18), (1.0, 0.02))
_COLUMN: Final = ((0.0, 0.50), (0.12, 0.90), (0.45, 1.0), (0.80, 0.72), (1.0, 0.12))
_TABLE: Final = ((0.0, 0.45), (0.25, 0.90), (0.55, 1.0), (0.80, 0.80), (1.0, 0.25))

_LIME_LEAF: Final = Leaf(_HEART, 0.125, (0.058, 0.118, 0.022), (0.40, 0.27, 0.035), (0.105, 0.190, 0.030))
_MAPLE_LEAF: Final = Leaf(_PALM, 0.14, (0.050, 0.105, 0.022), (0.47, 0.20, 0.025), (0.12, 0.18, 0.030), along=3)
#: Small leaves of clipped hedges and shrubs.
HEDGE_LEAF: Final = Leaf(_OVAL, 0.15, (0.036, 0.084, 0.018), (0.036, 0.084, 0.018), (0.075, 0.150, 0.026), along=5)

SPECIES: Final = {
    "lime": Species(
        TreeSettings(8.8, 2.7, 2.5, 0.16, clusters=150, branches=38, leaves=4, leaf=0.62), _EGG, _LIME_LEAF,
    ),
    "plane": Species(
        TreeSettings(10.4, 3.1, 3.1, 0.21, clusters=175, branches=44, leaves=4, leaf=0.74), _DOME,
        Leaf(_PALM, 0.155, (0.074, 0.128, 0.030), (0.30, 0.20, 0.040), (0.12, 0.19, 0.040), along=3),
        bark=("bark-plane", (1.0, 1.0, 1.0)), hang=0.15,
    ),
    "maple": Species(
        TreeSettings(8.4, 2.5, 2.5, 0.15, clusters=150, branches=36, leaves=4, leaf=0.64), _DOME, _MAPLE_LEAF,
    ),
    "oak": Species(
        TreeSettings(9.4, 2.6, 3.0, 0.20, clusters=210, branches=46, leaves=3, leaf=0.66), _DOME,
        Leaf(_LOBED, 0.17, (0.046, 0.092, 0.019), (0.27, 0.13, 0.030), (0.11, 0.16, 0.030), along=4),
        bark=("bark", (0.72, 0.66, 0.60)), hang=0.05,
    ),
    "chestnut": Species(
        TreeSettings(9.2, 2.7, 2.9, 0.20, clusters=180, branches=40, leaves=3, leaf=0.66), _DOME,
        Leaf(_LEAFLET, 0.18, (0.045, 0.098, 0.019), (0.34, 0.17, 0.025), (0.095, 0.165, 0.028), along=1, twigs=3, leaflets=6),
        bark=("bark", (0.80, 0.74, 0.70)), hang=0.25,
    ),
    "birch": Species(
        TreeSettings(9.8, 2.4, 1.8, 0.10, clusters=170, branches=50, leaves=3, leaf=0.59, rise=-0.10), _SLIM,
        Leaf(_RHOMB, 0.10, (0.082, 0.150, 0.030), (0.50, 0.36, 0.030), (0.13, 0.21, 0.035), along=6),
        bark=("bark-birch", (1.0, 1.0, 1.0)), hang=0.65, leader=True,
    ),
    "hornbeam": Species(
        TreeSettings(8.6, 2.1, 1.45, 0.13, clusters=150, branches=40, leaves=3, leaf=0.54, rise=0.22), _COLUMN,
        Leaf(_OVAL, 0.14, (0.050, 0.108, 0.022), (0.36, 0.22, 0.035), (0.10, 0.18, 0.028), along=5),
        bark=("bark", (0.85, 0.88, 0.92)), hang=-0.5, leader=True,
    ),
    "cherry": Species(
        TreeSettings(5.8, 2.0, 2.1, 0.12, clusters=145, branches=34, leaves=3, leaf=0.54), _DOME,
        Leaf(_OVAL, 0.12, (0.054, 0.098, 0.024), (0.42, 0.10, 0.025), (0.80, 0.55, 0.60), blossoms=True),
        bark=("bark-cherry", (1.0, 1.0, 1.0)),
    ),
    "poplar": Species(
        TreeSettings(13.0, 2.2, 1.6, 0.17, clusters=250, branches=64, leaves=3, leaf=0.55, rise=0.30), _COLUMN,
        Leaf(_RHOMB, 0.12, (0.064, 0.122, 0.026), (0.48, 0.34, 0.035), (0.12, 0.19, 0.035), along=5),
        bark=("bark", (0.90, 0.88, 0.80)), hang=-0.8, leader=True,
    ),
    "young": Species(
        TreeSettings(4.6, 2.1, 0.95, 0.045, clusters=50, branches=16, leaves=4, leaf=0.48), _EGG, _MAPLE_LEAF,
        hang=-0.2, leader=True, stakes=True,
    ),
    "spruce": Species(
        TreeSettings(11.0, 1.9, 2.2, 0.15, clusters=270, branches=96, leaves=3, leaf=0.70, rise=-0.10), _CONE,
        Leaf(_NEEDLE, 0.10, (0.021, 0.048, 0.022), (0.021, 0.048, 0.022), (0.034, 0.075, 0.026), along=34, twigs=5),
        bark=("bark-pine", (0.62, 0.55, 0.52)), hang=0.35, leader=True,
    ),
    "pine": Species(
        TreeSettings(11.5, 5.4, 2.7, 0.18, clusters=190, branches=38, leaves=4, leaf=0.52, rise=0.12), _TABLE,
        Leaf(_NEEDLE, 0.17, (0.040, 0.072, 0.034), (0.040, 0.072, 0.034), (0.052, 0.092, 0.036), along=8, leaflets=3),
        bark=("bark-pine", (1.0, 1.0, 1.0)), hang=-0.35, leader=True,
    ),
    "willow": Species(
        TreeSettings(9.0, 2.7, 3.2, 0.24, clusters=215, branches=56, leaves=3, leaf=0.88, rise=0.12), _DOME,
        Leaf(_LANCE, 0.16, (0.090, 0.142, 0.042), (0.40, 0.32, 0.050), (0.15, 0.21, 0.045), along=13, twigs=3),
        bark=("bark", (0.82, 0.80, 0.70)), hang=1.6,
    ),
}  # fmt: skip


def species_of(kind: str) -> Species | None:
    """Return the species of a placement of this kind, simplified for ``far-…``; None if it is no tree."""
    name = kind.removeprefix("far-")
    species = SPECIES.get(name)
    return species if species is None or name == kind else species.from_afar()


#: Kinds for kerbs, with the share of each among single trees, and kinds that need a garden's room.
_KERB: Final = {
    "lime": 2,
    "plane": 2,
    "maple": 2,
    "oak": 1,
    "chestnut": 2,
    "birch": 2,
    "hornbeam": 1,
    "cherry": 2,
    "young": 1,
}
_GARDEN: Final = ("spruce", "pine", "willow", "poplar", "oak")
_AVENUES: Final = ("lime", "plane", "maple", "chestnut")
_NARROW_AVENUES: Final = ("lime", "hornbeam", "maple", "birch")


def kerb_kinds(settings: StreetSettings, rng: np.random.Generator) -> Iterator[str]:
    """Yield kinds for one kerb: an avenue of one kind, with some trees of four others."""
    avenue = str(rng.choice(_AVENUES if settings.pavement_width_m >= 3.2 else _NARROW_AVENUES))
    share = np.array(list(_KERB.values())) / sum(_KERB.values())
    others = rng.choice(list(_KERB), 4, replace=False, p=share)
    while True:
        yield avenue if rng.random() < 0.6 else str(rng.choice(others))


def garden_kinds(rng: np.random.Generator) -> Iterator[str]:
    """Yield kinds for open ground, each of which comes once before any comes again."""
    while True:
        yield from (_GARDEN[k] for k in rng.permutation(len(_GARDEN)))
