"""Rules for the places of movers: a vehicle must not stand in a house, a parked car or another vehicle, nor leave its level
ground; a house must not stand in its neighbour or on a pavement.

Two rules keep an asset's own placement legal even with rough outlines. Only movers whose parameters a variant sets are judged.
A mover that overlaps something at its default place, or does not stand level there, is not judged against it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import shapely

from valerie.parameters.definitions import Value
from valerie.scene.assets.manifest import Footprint, Manifest
from valerie.scene.legality.ground import ground_height, level_ground
from valerie.scene.legality.movers import Mover
from valerie.scene.legality.obstacles import Outlines

_Polygons = tuple[shapely.Polygon, ...]


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
        self._together = frozenset((number, other) for number, polygon in own for other in self._others(polygon))

    def reason(self, assignment: Mapping[str, Value], moved: Sequence[int]) -> str | None:
        """Return the reason why a mover's place is illegal (``car-101 and bicycle-101 overlap``); None if all are legal.

        Args:
            assignment: path to value.
            moved: indices of the movers of whose pose it gives a part, in order.
        """
        polygons = {number: self._rules[number].mover.polygons(assignment) for number in moved}
        # The last mover, the first one (-1: alone) and the reason: the least is the one that judging in order meets first.
        found: list[tuple[int, int, str]] = []
        for number in moved:
            rule = self._rules[number]
            if not rule.mover.has_place:
                continue
            if reason := self._alone(rule, polygons[number], assignment):
                found.append((number, -1, reason))
                break
            still = {other for polygon in polygons[number] for other in self._others(polygon)} - polygons.keys()
            moving = {other for other in moved if other != number and _overlap(polygons[number], polygons[other])}
            for other in still | moving:
                if (number, other) not in self._together:
                    first, last = sorted((number, other))
                    names = (self._rules[index].mover.name for index in (first, last))
                    found.append((last, first, " and ".join(names) + " overlap"))
        return min(found)[2] if found else None

    def _others(self, polygon: shapely.Polygon) -> list[int]:
        """Return the indices of the movers whose default place a polygon overlaps."""
        return [self._owners[index] for index in self._own.query(polygon, predicate="intersects").tolist()]

    def _alone(self, rule: _Rule, polygons: _Polygons, assignment: Mapping[str, Value]) -> str | None:
        """Return the reason why a mover's place is illegal regardless of other movers; None if it is legal."""
        name = rule.mover.name
        if rule.keeps_within and not _within(polygons, self._extent):
            return f"{name} is outside the asset"
        if rule.grounds and not _stand_on(rule.mover.polygons(assignment, standing=True), rule.grounds):
            return f"{name} leaves its level ground"
        for polygon in polygons:
            obstacle = self._resting.first(polygon, but=rule.among)
            if obstacle is None and rule.ways is not None:
                obstacle = self._ways.first(polygon, but=rule.ways)
            if obstacle is not None:
                return f"{name} stands {obstacle.text}"
        return None


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
    own: _Polygons
    keeps_within: bool
    grounds: tuple[shapely.Geometry, ...]
    among: frozenset[int]
    ways: frozenset[int] | None


def _rule(manifest: Manifest, mover: Mover, resting: Outlines, ways: Outlines) -> _Rule:
    own, grounds = mover.polygons({}), _grounds(manifest, mover)
    return _Rule(
        mover,
        own,
        _within(own, manifest.extent),
        grounds if _stand_on(mover.polygons({}, standing=True), grounds) else (),
        frozenset(number for polygon in own for number in resting.below(polygon)),
        frozenset(number for polygon in own for number in ways.below(polygon)) if mover.is_built else None,
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


def _within(polygons: _Polygons, extent: tuple[float, float, float, float]) -> bool:
    x0, y0, x1, y1 = extent
    middles = (polygon.centroid for polygon in polygons)
    return all(x0 <= middle.x <= x1 and y0 <= middle.y <= y1 for middle in middles)


def _stand_on(standing: _Polygons, grounds: Sequence[shapely.Geometry]) -> bool:
    return all(any(ground.covers(polygon) for ground in grounds) for polygon in standing)


def _overlap(first: _Polygons, second: _Polygons) -> bool:
    return any(polygon.intersects(other) for polygon in first for other in second)
