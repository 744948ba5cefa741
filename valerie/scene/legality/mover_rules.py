"""Rules for the places of movers: a vehicle must not stand in a house, a parked car or another vehicle, nor leave its level
ground; a house must not stand in its neighbour or on a pavement.

Two rules keep an asset's own placement legal even with rough outlines. Only movers whose parameters a variant sets are judged.
A mover that overlaps something at its default place, or does not stand level there, is not judged against it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from valerie.scene.assets.manifest import Footprint, Manifest
from valerie.scene.legality.ground import ground_height, level_ground
from valerie.scene.legality.movers import Mover, Placed, Poses
from valerie.scene.legality.obstacles import Outlines, Polygons


class MoverRules:
    """The rules of one manifest.

    Args:
        manifest: declares extent, ground and ways.
        resting: the obstacles that no parameter moves or hides.
        movers: the other obstacles.
    """

    def __init__(self, manifest: Manifest, resting: Sequence[Footprint], movers: Sequence[Mover]) -> None:
        self._extent = manifest.extent
        self._resting = Outlines(resting)
        self._ways = Outlines(manifest.ways)
        self._rules = tuple(_rule(manifest, mover, self._resting, self._ways) for mover in movers)
        own = [(number, polygon) for number, rule in enumerate(self._rules) for polygon in rule.own]
        self._owners = [number for number, _ in own]
        self._own = shapely.STRtree([polygon for _, polygon in own])
        alone, met = self._own.query(self._own.geometries.astype(np.object_), predicate="intersects").tolist()
        self._together = {(self._owners[one], self._owners[other]) for one, other in zip(alone, met, strict=True)}

    def reasons(self, poses: Mapping[int, Poses]) -> dict[int, str]:
        """Return the reasons why a mover's place is illegal (``car-101 and bicycle-101 overlap``), by index of the variant.

        Args:
            poses: the poses of those movers of whose pose the variants give a part, by index in order.
        """
        # The last mover, the first one (-1: alone) and the reason: the least is the one that judging in order meets first.
        found: dict[int, tuple[int, int, str]] = {}
        for number, own in poses.items():
            rule = self._rules[number]
            if not rule.mover.has_place:
                continue
            whole = own.polygons()
            for index, reason in self._alone(rule, own, whole).items():
                alone = (number, -1, reason)
                found[index] = min(found.get(index, alone), alone)
            for index, other in (*self._still(whole, poses.keys()), *_moving(number, poses)):
                if (number, other) not in self._together:
                    first, last = sorted((number, other))
                    names = (self._rules[one].mover.name for one in (first, last))
                    overlap = (last, first, " and ".join(names) + " overlap")
                    found[index] = min(found.get(index, overlap), overlap)
        return {index: reason for index, (_, _, reason) in found.items()}

    def _still(self, whole: Placed, moved: Set[int]) -> Iterator[tuple[int, int]]:
        """Yield the index of a variant and that of a mover at rest that a mover overlaps."""
        for variants, polygons in whole:
            for met, other in zip(*self._own.query(polygons, predicate="intersects").tolist(), strict=True):
                if self._owners[other] not in moved:
                    yield int(variants[met]), self._owners[other]

    def _alone(self, rule: _Rule, poses: Poses, whole: Placed) -> dict[int, str]:
        """Return the reasons why a mover's place is illegal regardless of other movers, by index of the variant."""
        name, reasons = rule.mover.name, dict[int, str]()
        # Reasons that take precedence come later.
        for variants, polygons in reversed(whole):
            ways = {} if rule.ways is None else self._ways.first(polygons, but=rule.ways)
            for met, obstacle in (ways | self._resting.first(polygons, but=rule.among)).items():
                reasons[int(variants[met])] = f"{name} stands {obstacle.text}"
        if rule.grounds:
            for variants, standing in poses.polygons(standing=True):
                uneven = variants[~_stand_on(standing, rule.grounds)]
                reasons |= dict.fromkeys(uneven.tolist(), f"{name} leaves its level ground")
        if rule.keeps_within:
            for variants, polygons in whole:
                outside = variants[~_within(polygons, self._extent)]
                reasons |= dict.fromkeys(outside.tolist(), f"{name} is outside the asset")
        return reasons


@dataclass(frozen=True, slots=True, eq=False)
class _Rule:
    """The rule for one mover.

    Attributes:
        own: its outlines at the default place; empty if it is hidden by default.
        keeps_within: True if its middle must be within the asset's extent, as it is at the default place.
        grounds: pieces of ground; it must stand on one of them. Empty if a parameter lifts it, or if its default place is
            uneven.
        among: indices of the obstacles at rest that it overlaps at its default place.
        ways: indices of the ways that it may overlap because it does so at its default place; None if it may overlap all.
    """

    mover: Mover
    own: Polygons
    keeps_within: bool
    grounds: tuple[shapely.Geometry, ...]
    among: frozenset[int]
    ways: frozenset[int] | None


def _rule(manifest: Manifest, mover: Mover, resting: Outlines, ways: Outlines) -> _Rule:
    at_rest, grounds = mover.poses(({},)), _grounds(manifest, mover)
    own = np.concatenate([np.empty(0, np.object_), *(polygons for _, polygons in at_rest.polygons())])
    level = all(_stand_on(polygons, grounds).all() for _, polygons in at_rest.polygons(standing=True))
    return _Rule(
        mover,
        own,
        bool(_within(own, manifest.extent).all()),
        grounds if level else (),
        resting.below(own),
        ways.below(own) if mover.is_built else None,
    )


def _grounds(manifest: Manifest, mover: Mover) -> tuple[shapely.Geometry, ...]:
    """Return the pieces of level ground that a mover may stand on: at its own height, or at any height if it is grounded."""
    if f"{mover.path}.pos.z" in manifest.by_path:
        return ()
    if mover.path in manifest.grounded:
        heights = sorted({0.0, *(region.height for region in manifest.ground)})
    else:
        middle = shapely.Polygon(mover.outlines[0].footprint.polygon).centroid
        heights = [ground_height(manifest, middle.x, middle.y)]
    return tuple(level_ground(manifest, height) for height in heights)


def _within(polygons: Polygons, extent: tuple[float, float, float, float]) -> NDArray[np.bool_]:
    x0, y0, x1, y1 = extent
    x, y = shapely.get_coordinates(shapely.centroid(polygons)).T
    within: NDArray[np.bool_] = (x0 <= x) & (x <= x1) & (y0 <= y) & (y <= y1)
    return within


def _stand_on(standing: Polygons, grounds: Sequence[shapely.Geometry]) -> NDArray[np.bool_]:
    on = [shapely.covers(ground, standing) for ground in grounds]
    return np.logical_or.reduce(on) if on else np.zeros(len(standing), np.bool_)


def _moving(number: int, poses: Mapping[int, Poses]) -> Iterator[tuple[int, int]]:
    """Yield the index of a variant and that of another moved mover that a mover overlaps."""
    own = poses[number]
    for other, its in poses.items():
        near = np.flatnonzero(np.hypot(*(own.place - its.place).T) <= own.reach + its.reach)
        if other == number or not len(near):
            continue
        for variants, polygons in own.polygons(near):
            for those, others in its.polygons(near):
                both, first, second = np.intersect1d(variants, those, assume_unique=True, return_indices=True)
                for index in both[shapely.intersects(polygons[first], others[second])].tolist():
                    yield index, other
