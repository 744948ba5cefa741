"""Outlines on a car's glass house: panes, frames of doors, blackened posts."""

from __future__ import annotations

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from urban_street.vehicles.shell import HOUSE, Shell, rounded

#: Parts of a half of a car.
BODY, FRONT_DOOR, REAR_DOOR = "body", "front-door", "rear-door"


class Windows:
    """The outlines of one shell, in the domain of `Shell.house`."""

    def __init__(self, shell: Shell) -> None:
        self.shell = shell
        self.design = shell.design

    def _side_strip(
        self, front: tuple[float, float], rear: tuple[float, float], low: float, high: float
    ) -> BaseGeometry:
        """Return the strip of the house between lines (place at the belt, at the roof), from ``low`` to ``high`` (shares)."""
        f0, f1 = front
        r0, r1 = rear
        h = np.array([low, high])
        corners = [
            (r0 + (r1 - r0) * h[0], h[0]),
            (f0 + (f1 - f0) * h[0], h[0]),
            (f0 + (f1 - f0) * h[1], h[1]),
            (r0 + (r1 - r0) * h[1], h[1]),
        ]
        return shapely.Polygon([(a, HOUSE * b) for a, b in corners])

    def _posts(self) -> tuple[float, float, float, float]:
        """Return the places of the front pillar, the two posts between the side windows, and the glass's rear end."""
        at, d = self.shell.house_side, self.design
        pillar = float(self.shell.house_a(2.0)) - 0.055
        return pillar, float(at(d.posts[0][0])), float(at(d.posts[1][0])), float(at(d.quarter[0]))

    def panes(self) -> dict[str, list[BaseGeometry]]:
        """Return the daylight openings by part."""
        shell, d = self.shell, self.design
        frame, length = shell.house.domain, shell.house_length
        pillar, post, second, quarter = self._posts()
        low, high = 0.055, 0.86 * d.glass_top
        margin, top = (0.085, 0.86) if d.hatch else (0.07, 0.95)
        windscreen = shapely.box(float(shell.house_a(2.0)) + 0.055, 0.045 * HOUSE, length, 0.955 * d.glass_top * HOUSE)
        rear = shapely.box(0.0, 0.07 * HOUSE, float(shell.house_a(1.0)) - margin, top * d.glass_top * HOUSE)
        first = self._side_strip((pillar - 0.10, pillar - 0.012), (post + 0.045, post + 0.045), low, high)
        panes: dict[str, list[BaseGeometry]] = {
            BODY: [rounded(windscreen, 0.05, frame)],
            FRONT_DOOR: [rounded(first, 0.025, frame)],
            REAR_DOOR: [],
        }
        if d.back == "open":
            return {BODY: panes[BODY]}
        if d.back != "box":
            panes[BODY].append(rounded(rear, 0.06, frame))
        if d.panel_van:
            return panes
        ends = (quarter - 0.10, quarter + 0.10)
        if self._has_quarter:
            last = self._side_strip((second - 0.035, second - 0.035), ends, low, high)
            panes[BODY].append(rounded(last, 0.03, frame))
            ends = (second + 0.02, second + 0.02)
        middle = self._side_strip((post - 0.045, post - 0.045), ends, low, high)
        panes[BODY if d.two_doors else REAR_DOOR].append(rounded(middle, 0.025, frame))
        return panes

    @property
    def _has_quarter(self) -> bool:
        """Return True if there is a third side window behind the doors."""
        _, _, second, quarter = self._posts()
        return not self.design.panel_van and second - quarter > 0.22

    def door_frames(self) -> dict[str, BaseGeometry]:
        """Return the parts of the doors on the glass house."""
        pillar, post, second, quarter = self._posts()
        fixed = self._has_quarter or self.design.panel_van
        ends = (second - 0.02, second - 0.02) if fixed else (quarter - 0.10, quarter + 0.03)
        strips = {
            FRONT_DOOR: self._side_strip((pillar, pillar + 0.055), (post, post), -0.1, 0.955),
            REAR_DOOR: self._side_strip((post, post), ends, -0.1, 0.955),
        }
        if self.design.back == "open":
            strips = {}
        elif self.design.two_doors:
            del strips[REAR_DOOR]
        return {name: strip.intersection(self.shell.house.domain) for name, strip in strips.items()}

    def blackened(self, panes: list[BaseGeometry]) -> BaseGeometry:
        """Return posts, mirror triangle and seals around the panes."""
        pillar, post, second, _ = self._posts()
        pieces = [pane.buffer(0.013, quad_segs=4) for pane in panes]
        if self.design.back == "open":
            return shapely.union_all(pieces)
        pieces.append(self._side_strip((pillar, pillar), (pillar - 0.13, pillar - 0.13), 0.035, 0.40))
        if not self.design.panel_van:
            pieces.append(self._side_strip((post + 0.06, post + 0.06), (post - 0.06, post - 0.06), 0.035, 0.88))
        if self._has_quarter:
            pieces.append(self._side_strip((second + 0.03, second + 0.03), (second - 0.05, second - 0.05), 0.035, 0.88))
        return shapely.union_all(pieces)
