"""The wood of trees: a forked trunk, limbs, branches, and a twig to every cluster of leaves, so that no leaf floats."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from urban_street.solids.surfaces import Bag, Floats, tubes


@dataclass(frozen=True, slots=True)
class TreeSettings:
    """The shape of one tree; lengths in metres.

    Attributes:
        height: height of the crown's top above the foot.
        fork: height at which the trunk divides. The crown begins slightly above.
        radius: radius of the crown.
        trunk: radius of the trunk at its foot.
        clusters, leaves, branches: number of clusters of leaves, of cards per cluster, and of branches.
        leaf: side of a card.
        rise: upward bend of branches as a share of their length; negative for drooping branches.
    """

    height: float
    fork: float
    radius: float
    trunk: float
    clusters: int
    branches: int
    leaves: int
    leaf: float
    rise: float = 0.10


def build_wood(
    settings: TreeSettings,
    clusters: Floats,
    rng: np.random.Generator,
    *,
    bark: str,
    leader: bool,
    foot: float,
) -> Bag:
    """Build trunk, limbs, branches, and a twig to each of the (N, 3) ``clusters``.

    Args:
        settings: size and density.
        clusters: centres of the clusters, metres.
        rng: source of its random choices.
        bark: material.
        leader: True if the trunk runs up to the top instead of dividing.
        foot: height of the trunk's lowest ring, metres.
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
        tubes(branches, np.linspace(0.24, 0.08, branches.shape[1])[None] * settings.trunk, 4, tile=wood),
        tubes(fine, np.linspace(0.075, 0.02, fine.shape[1])[None] * settings.trunk, 3, tile=wood),
    )
    return bag


def _leader(settings: TreeSettings, fork: Floats) -> Floats:
    """Return the trunk from the fork to the top, (1, steps, 3)."""
    top = np.array([[0.0, 0.0, settings.height - 0.2]])
    return _bezier(fork[None], np.array([[*(-0.5 * fork[:2]), 0.5 * (settings.fork + settings.height)]]), top, 8)


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
