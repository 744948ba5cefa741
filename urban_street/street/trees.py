"""Street trees: a forked trunk, limbs, branches and twigs, and thousands of small leaves in clusters.

The crown comes first (clusters of leaves in an egg of uneven lobes). Then wood grows to every cluster, so crowns look full from
any side and no leaf floats.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from urban_street.solids.surfaces import Bag, Floats, Surface, tubes, unit
from urban_street.street.plan import Season

_GOLDEN_ANGLE = np.pi * (3.0 - np.sqrt(5.0))
#: Bunches of leaves along each edge of their texture, darker rows first.
BUNCHES = 8
#: Corners of the triangle that a bunch fills, (right, down) in its cell: its tip, then its feet.
_BUNCH = np.array([[0.5, 0.05], [0.05, 0.95], [0.95, 0.95]])


@dataclass(frozen=True, slots=True)
class TreeSettings:
    """The shape of one tree; lengths in metres.

    Attributes:
        height: height of the crown's top above the foot.
        fork: height at which the trunk divides. The crown begins slightly above.
        radius: radius of the crown.
        trunk: radius of the trunk at its foot.
        clusters, leaves, branches: number of clusters, of leaves per cluster, and of branches.
        leaf: length of a leaf.
        taper: difference between the radii of the crown's bottom and top, as a share of the radius.
        under: flatness of the crown's underside; 1 is round.
        rise: upward bend of branches as a share of their length; negative for drooping branches.
    """

    height: float = 8.2
    fork: float = 2.7
    radius: float = 2.35
    trunk: float = 0.15
    clusters: int = 230
    branches: int = 34
    leaves: int = 30
    leaf: float = 0.125
    taper: float = 0.28
    under: float = 0.86
    rise: float = 0.10


@dataclass(frozen=True, slots=True)
class Tree:
    """A species: its shape and its materials.

    Attributes:
        shape: its shape in summer.
        bark, twigs, leaves: materials. By default, twigs have that of the trunk, and leaves one of the shared materials.
    """

    shape: TreeSettings
    bark: str = "bark"
    twigs: str = ""
    leaves: str = ""


#: Lime, plane, birch, hornbeam trained as a column, ornamental cherry.
SPECIES = {
    "tree": Tree(TreeSettings()),
    "plane": Tree(
        TreeSettings(
            height=10.5, fork=3.1, radius=3.1, trunk=0.21, clusters=310, branches=44, leaves=34, leaf=0.17, taper=0.12, under=0.66
        ),
        bark="bark-plane",
        leaves="leaves-plane",
    ),
    "birch": Tree(
        TreeSettings(
            height=9.8, fork=2.6, radius=1.75, trunk=0.095, clusters=260, branches=44, leaves=30, leaf=0.11,
            taper=0.42, under=1.0, rise=-0.16,
        ),
        bark="bark-birch",
        twigs="bark-cherry",
        leaves="leaves-birch",
    ),
    "hornbeam": Tree(
        TreeSettings(
            height=8.6, fork=1.9, radius=1.25, trunk=0.12, clusters=220, branches=32, leaves=34, leaf=0.12, taper=0.30, under=1.0,
            rise=0.22,
        ),
        leaves="leaves-hornbeam",
    ),
    "cherry": Tree(
        TreeSettings(
            height=5.6, fork=1.75, radius=2.1, trunk=0.12, clusters=190, branches=30, leaves=34, leaf=0.12, taper=0.05, under=0.7
        ),
        bark="bark-cherry",
        leaves="leaves-cherry",
    ),
}  # fmt: skip


def from_afar(shape: TreeSettings) -> TreeSettings:
    """Return the same tree with fewer and larger leaves."""
    return replace(
        shape, clusters=round(0.4 * shape.clusters), branches=round(0.6 * shape.branches), leaf=1.6 * shape.leaf
    )


def in_season(shape: TreeSettings, season: Season, *, blossoms: bool = False) -> TreeSettings:
    """Return the tree's shape in a season: small leaves in spring, fewer in autumn, none in winter.

    Args:
        shape: the shape in summer.
        blossoms: True if the tree is covered with blossoms in spring.
    """
    if season == "spring" and not blossoms:
        return replace(shape, leaves=round(0.8 * shape.leaves), leaf=0.82 * shape.leaf)
    if season == "autumn":
        return replace(shape, leaves=round(0.62 * shape.leaves))
    return replace(shape, leaves=0) if season == "winter" else shape


def build_tree(settings: TreeSettings, rng: np.random.Generator, *, bark: str, leaves: str, twigs: str = "") -> Bag:
    """Build one tree with its foot at the origin.

    Args:
        settings: size and density.
        rng: source of its random choices.
        bark: material of the wood.
        leaves: material of the leaves.
        twigs: material of branches and twigs; empty for that of the wood.
    """
    clusters = _crown(settings, rng)
    bag = build_wood(settings, clusters, rng, bark=bark, twigs=twigs)
    bag.add(leaves, _leaves(settings, clusters, rng))
    return bag


def build_wood(
    settings: TreeSettings,
    clusters: Floats,
    rng: np.random.Generator,
    *,
    bark: str,
    twigs: str = "",
    leader: bool = False,
    foot: float = 0.0,
) -> Bag:
    """Build trunk, limbs, branches, and a twig to each of the (N, 3) ``clusters``.

    With a ``leader``, the trunk runs up to the top instead of dividing. It begins at height ``foot``. See `build_tree` for the
    other arguments.
    """
    bag = Bag()
    fork = np.array([*rng.normal(0.0, 0.06, 2), settings.fork])
    if leader:
        limbs, thickness = _leader(settings, fork), np.linspace(0.86, 0.10, 8)
    else:
        limbs = _limbs(settings, fork, int(rng.integers(5, 7)), rng)
        thickness = np.linspace(0.62, 0.2, limbs.shape[1])
    start = 0 if leader else limbs.shape[1] // 3
    branches = _branches(settings, limbs[:, start:], clusters, rng)
    fine = _reach(branches[:, 1:], clusters, rng, sag=0.12)[:, [0, 2, 3]]
    trunk = _bezier(np.array([[0.0, 0.0, foot]]), np.array([[*(fork[:2] * 1.5), 0.5 * settings.fork]]), fork[None], 7)
    flare = np.array([1.45, 1.08, 1.0, 0.95, 0.9, 0.88, 0.86]) * settings.trunk
    wood = (0.5, 1.0)
    bag.add(
        bark,
        tubes(trunk, flare[None], 10, tile=wood),
        tubes(limbs, thickness[None] * settings.trunk, 7, tile=wood),
    )
    bag.add(
        twigs or bark,
        tubes(branches, np.linspace(0.24, 0.08, branches.shape[1])[None] * settings.trunk, 4, tile=wood),
        tubes(fine, np.linspace(0.075, 0.02, fine.shape[1])[None] * settings.trunk, 3, tile=wood),
    )
    return bag


def _leader(settings: TreeSettings, fork: Floats) -> Floats:
    """Return the trunk from the fork to the top, (1, steps, 3)."""
    top = np.array([[0.0, 0.0, settings.height - 0.2]])
    return _bezier(fork[None], np.array([[*(-0.5 * fork[:2]), 0.5 * (settings.fork + settings.height)]]), top, 8)


def _crown(settings: TreeSettings, rng: np.random.Generator) -> Floats:
    """Return the centres of clusters, (clusters, 3), mostly near the surface of an egg whose radius varies with direction."""
    count = settings.clusters
    index = np.arange(count) + 0.5
    polar = np.arccos(1.0 - 2.0 * index / count)
    azimuth = index * _GOLDEN_ANGLE + rng.uniform(0.0, 2.0 * np.pi)
    direction = np.stack([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)], -1)
    direction = unit(direction + rng.normal(0.0, 0.10, (count, 3)))
    lobes = unit(rng.normal(size=(9, 3)))
    bulge = 0.80 + 0.30 * np.max((direction @ lobes.T) ** 5, axis=1)
    depth = rng.uniform(0.22, 1.0, count) ** 0.42
    bottom = settings.fork + 0.15
    half = 0.5 * (settings.height - bottom)
    scale = np.array([settings.radius, settings.radius, half])
    centres = direction * (bulge * depth)[:, None] * scale
    # an egg, broadest below the middle and flatter underneath
    lift = centres[:, 2] / half
    centres[:, :2] *= (1.05 - settings.taper * lift)[:, None]
    centres[:, 2] = np.where(lift < 0.0, centres[:, 2] * settings.under, centres[:, 2])
    return np.asarray(centres + np.array([0.0, 0.0, bottom + half]))


def _bezier(start: Floats, control: Floats, end: Floats, steps: int) -> Floats:
    """Return points on quadratic curves, (N, steps, 3)."""
    t = np.linspace(0.0, 1.0, steps)[None, :, None]
    curve: Floats = (1 - t) ** 2 * start[:, None] + 2 * t * (1 - t) * control[:, None] + t**2 * end[:, None]
    return curve


def _limbs(settings: TreeSettings, fork: Floats, count: int, rng: np.random.Generator) -> Floats:
    """Return limbs, (count, steps, 3): one leader up the middle, the others spreading and rising."""
    angle = np.arange(count) * 2.0 * np.pi / (count - 1) + rng.normal(0.0, 0.25, count)
    spread = rng.uniform(0.42, 0.62, count) * settings.radius
    top = settings.fork + rng.uniform(0.5, 0.72, count) * (settings.height - settings.fork)
    spread[0], top[0] = 0.12 * settings.radius, settings.height - 1.0
    end = np.stack([np.cos(angle) * spread, np.sin(angle) * spread, top], -1)
    start = np.broadcast_to(fork, end.shape) - np.array([0.0, 0.0, 0.12])
    control = start + (end - start) * np.array([0.62, 0.62, 0.36])
    return _bezier(start, control, end, 6)


def _branches(settings: TreeSettings, limbs: Floats, clusters: Floats, rng: np.random.Generator) -> Floats:
    """Return branches, (branches, steps, 3), from limbs towards well-spread clusters."""
    targets = clusters[rng.permutation(len(clusters))[: settings.branches]]
    centre = np.array([0.0, 0.0, settings.fork + 0.45 * (settings.height - settings.fork)])
    return _reach(limbs, centre + (targets - centre) * 0.82, rng, sag=-settings.rise)


def _reach(wood: Floats, targets: Floats, rng: np.random.Generator, *, sag: float) -> Floats:
    """Return curves from the nearest point of the wood to each target, (N, 4, 3)."""
    outer = wood.reshape(-1, 3)
    # Wood grows up and out, so starting points above the target count as farther away.
    difference = targets[:, None] - outer[None]
    cost = np.linalg.norm(difference, axis=-1) + 0.6 * np.maximum(-difference[..., 2], 0.0)
    start = outer[np.argmin(cost, axis=1)]
    length = np.linalg.norm(targets - start, axis=1, keepdims=True)
    control = 0.5 * (start + targets) + rng.normal(0.0, 0.06, start.shape) * length
    control[:, 2] += sag * length[:, 0]
    return _bezier(start, control, targets, 4)


def on_bunches(columns: Floats, rows: Floats) -> Floats:
    """Return the (N, 3, 2) texture coordinates of triangles, tip first, that show the bunches in columns and rows, (N,)."""
    return np.asarray((np.stack([columns, rows], -1)[:, None] + _BUNCH) / BUNCHES)


def _leaves(settings: TreeSettings, clusters: Floats, rng: np.random.Generator) -> Surface:
    """Build a pointed triangle per bunch of leaves. Normals lean outwards, so that a crown is shaded as a mass of leaves."""
    count = settings.leaves * len(clusters)
    spread = 0.27 * (230 / settings.clusters) ** (1 / 3)
    centre = np.repeat(clusters, settings.leaves, axis=0)
    place = centre + np.clip(rng.normal(0.0, 1.0, (count, 3)), -1.9, 1.9) * np.array([spread, spread, 0.72 * spread])
    middle = clusters.mean(axis=0)
    outward = unit(place - middle)
    facing = unit(rng.normal(size=(count, 3)) + np.array([0.0, 0.0, 0.55]) + 0.35 * outward)
    along = unit(np.cross(facing, rng.normal(size=(count, 3))) + np.array([0.0, 0.0, -0.25]))
    across = unit(np.cross(facing, along))
    size = settings.leaf * rng.uniform(0.7, 1.3, (count, 1))
    tip, left, right = (
        along * 0.6 * size,
        (-0.45 * along + 0.42 * across) * size,
        (-0.45 * along - 0.42 * across) * size,
    )
    corners = place[:, None] + np.stack([tip, left, right], 1)
    face = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    tilted = np.sum(face * facing, axis=1) < 0.0
    corners[tilted] = corners[tilted][:, ::-1]
    shading = unit(facing + 0.9 * outward + np.array([0.0, 0.0, 0.25]))
    # Leaves inside the crown show the dark half of the bunches.
    inside = np.linalg.norm(
        (place - middle) / np.array([settings.radius, settings.radius, 0.45 * settings.height]), axis=1
    )
    column = np.floor(rng.uniform(0.0, BUNCHES, count))
    row = np.floor(np.clip(inside * 0.7 + rng.uniform(0.0, 0.3, count), 0.0, 0.999) * BUNCHES)
    return Surface(
        corners.reshape(-1, 3),
        np.repeat(shading, 3, axis=0),
        on_bunches(column, row).reshape(-1, 2),
        np.arange(3 * count).reshape(-1, 3),
    )
