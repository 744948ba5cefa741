"""The smooth master surfaces of a car: flanks with nose and tail, deck, glass house, roof."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import shapely
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline
from shapely.geometry.base import BaseGeometry

from urban_street.solids.surfaces import Floats
from urban_street.vehicles.curves import PlanOutline, hermite, smooth
from urban_street.vehicles.designs import CarDesign
from urban_street.vehicles.skin import Master, along_polyline

#: Index of the flank's last rail, from 0 (sill) to 8 (belt). The shoulder line is a crease.
RAILS = 8
_CREASES = (5,)
#: Domain half width of deck and roof, and domain height of the glass house, metres.
DECK = 0.8
HOUSE = 0.5
#: Places of the sections.
_PLACES = ("tail", "tail-corner", "rear", "middle", "front", "nose-corner", "nose")


class Shell:
    """Master surfaces of one design, for the half x ≥ 0; ``fine`` is False for distant views.

    Domains are approximately in metres. Ring: arc length along the plan outline from the middle of the tail, and height above
    the sill. Deck: the same arc length, and −`DECK` … `DECK` from the right to the left edge. House and roof: arc length from
    the middle of the rear window to the middle of the windscreen, and 0 … `HOUSE` from belt to roof, or −`DECK` … `DECK`.
    """

    def __init__(self, design: CarDesign, *, fine: bool = True) -> None:
        self.design = design
        self.fine = fine
        half, end = 0.5 * design.width, 0.5 * design.length
        tail = [(half * f, -end + d) for f, d in design.tail_plan]
        nose = [(half * f, end - d) for f, d in design.nose_plan][::-1]
        self.outline = PlanOutline([*tail, (half, 0.5 * (tail[-1][1] + nose[0][1])), *nose])
        outline = self.outline
        places = np.array(
            [
                0.0,
                float(outline.at_x(0.86 * half, front=False)),
                float(outline.at_y(design.rear_axle)),
                float(outline.at_y(0.5 * (design.rear_axle + design.front_axle))),
                float(outline.at_y(design.front_axle)),
                float(outline.at_x(0.80 * half, front=True)),
                outline.length,
            ]
        )
        table = np.array([design.sections[name] for name in _PLACES])  # (7, 9, 2)
        middle = _PLACES.index("middle")
        #: Domain heights of the rails: metres above the sill on a door.
        belt, sill = (float(np.interp(0.0, *np.array(line).T)) for line in (design.belt, design.sill))
        self.heights = table[middle, :, 1] * (belt - sill)
        self._inset = smooth(places, table[..., 0])
        self._share = smooth(places, table[..., 1])
        t = np.linspace(0.0, outline.length, 400)
        y = outline.at(t)[0][:, 1]
        self._belt = smooth(t[::4], smooth(*zip(*design.belt, strict=True))(y)[::4])
        self._sill = smooth(t[::4], smooth(*zip(*design.sill, strict=True))(y)[::4])

    # -- the ring -----------------------------------------------------------------------------------------------------

    def _levels(self, t: Floats) -> Floats:
        """Return the heights of the rails, (N, 9)."""
        low, high = self._sill(t)[:, None], self._belt(t)[:, None]
        return np.asarray(low + (high - low) * self._share(t))

    def _ring_points(self, at: Floats) -> Floats:
        t, rail = at[:, 0], np.interp(at[:, 1], self.heights, np.arange(RAILS + 1.0))
        levels = self._levels(t)
        lower = np.minimum(rail.astype(np.int64), RAILS - 1)
        row = np.arange(len(at))
        z = levels[row, lower] + (rail - lower) * (levels[row, lower + 1] - levels[row, lower])
        inset = hermite(levels, self._inset(t), z, _CREASES)
        plan, normal = self.outline.at(t)
        xy = plan - normal * inset[:, None]
        # a lip around the wheel arches
        for axle in (self.design.rear_axle, self.design.front_axle):
            beyond = np.hypot(xy[:, 1] - axle, z - self.design.tyre) - self.design.arch
            xy = xy + normal * (0.014 * np.exp(-((np.maximum(beyond, 0.0) / 0.035) ** 2)) * (z < 0.9))[:, None]
        xy[:, 0] = np.where((t <= 0.0) | (t >= self.outline.length), 0.0, xy[:, 0])
        return np.column_stack([xy, z])

    @cached_property
    def ring(self) -> Master:
        """Return flank, nose and tail as one surface, from the sill to the belt."""
        outline = self.outline
        corners = [
            float(outline.at_x(0.60 * 0.5 * self.design.width, front=False)),
            float(outline.at_y(self._tail_end)),
        ]
        corners += [
            float(outline.at_y(self._nose_end)),
            float(outline.at_x(0.60 * 0.5 * self.design.width, front=True)),
        ]
        stops = [0.0, *corners, outline.length]
        steps = (0.15, 0.07, 0.17, 0.07, 0.13)
        t = np.unique(
            np.concatenate(
                [
                    np.linspace(a, b, int((b - a) / step) + 2)
                    for a, b, step in zip(stops[:-1], stops[1:], steps, strict=True)
                ]
            )
        )
        rails = np.array([0, 1, 2, 2.6, 3.2, 3.65, 4, 4.5, 5, 5.5, 6, 7, 7.5, 8.0])
        return self._detailed(
            Master(self._ring_points, (0.0, 0.0), (outline.length, self.top), (t, self.height_of(rails)))
        )

    def _detailed(self, master: Master) -> Master:
        """Return the surface, with fewer lines unless the shell is fine."""
        return master if self.fine else master.coarse(2)

    @property
    def top(self) -> float:
        """Return the domain height of the belt."""
        return float(self.heights[-1])

    def height_of(self, rail: ArrayLike) -> Floats:
        """Return the domain heights of rails, which may be fractional."""
        return np.asarray(np.interp(np.asarray(rail, np.float64), np.arange(RAILS + 1.0), self.heights))

    @property
    def _tail_end(self) -> float:
        return -0.5 * self.design.length + 0.45

    @property
    def _nose_end(self) -> float:
        return 0.5 * self.design.length - 0.7

    def rail_at(self, t: ArrayLike, z: ArrayLike) -> Floats:
        """Return the domain heights, clipped to the ring, of the places ``t`` at ``z`` metres above the road."""
        where, height = (np.atleast_1d(np.asarray(v, np.float64)) for v in np.broadcast_arrays(t, z))
        levels = self._levels(where)
        piece = np.clip((levels[:, 1:-1] <= height[:, None]).sum(axis=1), 0, RAILS - 1)
        row = np.arange(len(where))
        low, high = levels[row, piece], levels[row, piece + 1]
        return self.height_of(np.clip(piece + (height - low) / (high - low), 0.0, RAILS))

    def side(self, line: ArrayLike, *, step: float = 0.06) -> Floats:
        """Return the ring places, (M, 2), of a polyline (y, z) in the side view."""
        fine = along_polyline(np.asarray(line, np.float64), step if self.fine else 3.0 * step)
        t = self.outline.at_y(fine[:, 0])
        return np.column_stack([t, self.rail_at(t, fine[:, 1])])

    def bow(self, line: ArrayLike, *, front: bool, step: float = 0.07) -> Floats:
        """Return the ring places, (M, 2), of a polyline (place along the bow, rail).

        The place is the distance from the middle along nose or tail in half widths; 1 is about the corner.
        """
        half = 0.5 * self.design.width
        points = np.asarray(line, np.float64)
        fine = along_polyline(points, step if self.fine else 2.0 * step)
        along = fine[:, 0] * half
        return np.column_stack([self.outline.length - along if front else along, self.height_of(fine[:, 1])])

    def side_polygon(self, line: ArrayLike) -> BaseGeometry:
        outline = np.asarray(line, np.float64)
        return shapely.Polygon(self.side(np.concatenate([outline, outline[:1]]))).buffer(0)

    def bow_polygon(self, line: ArrayLike, *, front: bool, rounding: float = 0.0) -> BaseGeometry:
        outline = np.asarray(line, np.float64)
        shape = shapely.Polygon(self.bow(np.concatenate([outline, outline[:1]]), front=front)).buffer(0)
        return rounded(shape, rounding, self.ring.domain) if rounding else shape

    def arch(self, axle: float, *, wider: float = 0.0) -> Floats:
        """Return the widened circle of a wheel arch in (y, z), (M, 2), about as far as the sill."""
        angle = np.linspace(-0.35, np.pi + 0.35, 41)
        radius = self.design.arch + wider
        return np.column_stack([axle + radius * np.cos(angle), self.design.tyre + radius * np.sin(angle)])

    # -- the deck -----------------------------------------------------------------------------------------------------

    def _deck_points(self, at: Floats) -> Floats:
        t, u = at[:, 0], at[:, 1] / DECK
        edge = self._ring_points(np.column_stack([t, np.full_like(t, self.top)]))
        y = edge[:, 1]
        end = 0.5 * self.design.length
        front = self.design.bonnet_crown * _fall((end - 0.13 - y) / (end - 0.13 - self.design.cowl))
        rear = self.design.boot_crown * _fall((y + end - 0.10) / 0.5)
        crown = np.where(y > 0.0, front, rear)
        # two ridges along the bonnet
        ridge = 0.010 * np.exp(-(((np.abs(u) - 0.62) / 0.10) ** 2)) * (y > 0.0) * _fall((end - 0.2 - y) / 0.5)
        z = edge[:, 2] + crown * (1.0 - np.abs(u) ** 2.4) + ridge
        return np.column_stack([edge[:, 0] * u, y, z])

    @cached_property
    def deck(self) -> Master:
        """Return the surface between the upper edges of both flanks; u = 1 is the right edge."""
        t = np.unique(np.append(self.ring.lines[0], self.outline.length - 0.04))
        u = np.array([-1, -0.93, -0.85, -0.74, -0.62, -0.5, -0.28, 0, 0.28, 0.5, 0.62, 0.74, 0.85, 0.93, 1.0])
        # d/dt × d/du must point up. Since t runs forwards on the right, u runs to the left.
        top = Master(
            lambda at: self._deck_points(at * np.array([1.0, -1.0])),
            (0.0, -DECK),
            (self.outline.length, DECK),
            (t, DECK * u),
        )
        return self._detailed(top)

    def deck_t(self, y: ArrayLike) -> Floats:
        """Return the arc lengths at which the upper edge passes ``y``."""
        t = np.linspace(0.0, self.outline.length, 800)
        edge = self._ring_points(np.column_stack([t, np.full_like(t, self.top)]))[:, 1]
        return np.asarray(np.interp(np.asarray(y, np.float64), np.maximum.accumulate(edge), t))

    def deck_height(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """Return the height of the deck at (x, y)."""
        across, along = (np.atleast_1d(np.asarray(v, np.float64)) for v in np.broadcast_arrays(x, y))
        t = self.deck_t(along)
        half = self._ring_points(np.column_stack([t, np.full_like(t, self.top)]))[:, 0]
        u = np.clip(across / np.maximum(half, 1e-6), -1.0, 1.0)
        return np.asarray(self._deck_points(np.column_stack([t, DECK * u]))[:, 2])

    # -- the glass house ----------------------------------------------------------------------------------------------

    @cached_property
    def _house_lines(self) -> tuple[CubicSpline, CubicSpline]:
        """Return base and roof edge (x, y, z) over the place q: 0 tail, 1 and 2 corners, 3 middle of the windscreen."""
        d = self.design
        q_side = np.linspace(1.0, 2.0, 25)
        inset = 0.004

        def base_x(y: Floats) -> Floats:
            t = self.deck_t(y)
            return self._ring_points(np.column_stack([t, np.full_like(t, self.top)]))[:, 0] - inset

        # the pillars, as pairs of places at belt and roof
        pairs = sorted([(d.rear_base, d.rear_top), d.quarter, *d.posts, (d.pillar_base, d.pillar_top)])
        low, high = np.array(pairs).T
        share = (q_side - 1.0) * (d.pillar_base - d.rear_base) + d.rear_base
        roof_y = smooth(low, high)(share)
        roof_x = d.rail[0] * (1.0 - 0.05 * ((roof_y + 0.45) / 1.3) ** 2)
        rail_z = (
            d.rail[1]
            - 0.03 * np.maximum((roof_y + 0.2) / 0.6, 0.0) ** 2
            - 0.018 * np.maximum(-(roof_y + 0.5), 0.0) ** 2
        )
        side_base = np.column_stack([base_x(share), share])
        side_roof = np.column_stack([roof_x, roof_y, rail_z])

        def ends(corner: Floats, middle_y: float, power: float, q0: float, q1: float) -> tuple[Floats, Floats]:
            """Return a bowed line from the middle (x = 0) to the corner."""
            f = np.linspace(0.0, 1.0, 13)[:-1]
            return q0 + (q1 - q0) * f, np.column_stack([corner[0] * f, middle_y + (corner[1] - middle_y) * f**power])

        q_tail, tail = ends(side_base[0], d.glass_tail, 3.2, 0.0, 1.0)
        q_nose, nose = ends(side_base[-1], d.cowl, 2.2, 3.0, 2.0)
        _, tail_roof = ends(side_roof[0], d.roof_rear, 2.6, 0.0, 1.0)
        _, nose_roof = ends(side_roof[-1], d.roof_front, 2.2, 3.0, 2.0)
        q = np.concatenate([q_tail, q_side, q_nose[::-1]])
        base = np.concatenate([tail, side_base, nose[::-1]])
        z = self.deck_height(base[:, 0], base[:, 1]) - 0.012
        roof_xy = np.concatenate([tail_roof, side_roof[:, :2], nose_roof[::-1]])
        crown = d.height - 0.012 - d.rail[1]
        z_tail = side_roof[0, 2] + 0.78 * crown * (1.0 - (tail_roof[:, 0] / side_roof[0, 0]) ** 2)
        z_nose = side_roof[-1, 2] + 0.80 * crown * (1.0 - (nose_roof[:, 0] / side_roof[-1, 0]) ** 2)
        roof = np.column_stack([roof_xy, np.concatenate([z_tail, side_roof[:, 2], z_nose[::-1]])])
        # A moving average along the edge, less than a hand wide, rounds the corners.
        q_fine = np.linspace(0.0, 3.0, 601)
        lines = []
        for line in (np.column_stack([base, z]), roof):
            fine = np.column_stack([np.interp(q_fine, q, line[:, k]) for k in range(3)])
            lines.append(CubicSpline(q_fine[::6], _rounded_corners(fine, 15)[::6]))
        return lines[0], lines[1]

    def _house_points(self, at: Floats) -> Floats:
        base, roof = self._house_lines
        q, h = self.house_place(at[:, 0]), at[:, 1] / HOUSE
        low, high = base(q), roof(q)
        points = low + (high - low) * h[:, None]
        slope = base(np.minimum(q + 1e-3, 3.0)) - base(np.maximum(q - 1e-3, 0.0))
        flat = np.column_stack([slope[:, 1], -slope[:, 0]])
        flat /= np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-9)
        bulge = (
            0.032
            * np.sin(np.pi * np.clip(h, 0.0, 1.0))
            * np.interp(q, [0, 0.8, 1.1, 1.9, 2.2, 3], [0.4, 0.5, 1, 1, 0.5, 0.4])
        )
        points[:, :2] += flat * bulge[:, None]
        points[:, 0] = np.where((q <= 0.0) | (q >= 3.0), 0.0, points[:, 0])
        return points

    @cached_property
    def house(self) -> Master:
        """Return the glass house, from the belt to the roof."""
        q = np.unique(
            np.concatenate(
                [
                    np.linspace(0, 0.8, 5),
                    np.linspace(0.8, 1.1, 6),
                    np.linspace(1.1, 1.9, 10),
                    np.linspace(1.9, 2.2, 6),
                    np.linspace(2.2, 3.0, 5),
                ]
            )
        )
        h = np.array([0, 0.25, 0.5, 0.75, 0.93, 1.0])
        sides = Master(self._house_points, (0.0, 0.0), (self.house_length, HOUSE), (self.house_a(q), HOUSE * h))
        return self._detailed(sides)

    @cached_property
    def _house_arc(self) -> tuple[Floats, Floats]:
        """Return the places and arc lengths along the middle between base and roof edge."""
        q = np.linspace(0.0, 3.0, 601)
        base, roof = self._house_lines
        line = 0.5 * (base(q) + roof(q))
        return q, np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])

    @property
    def house_length(self) -> float:
        """Return the largest first domain coordinate of house and roof."""
        return float(self._house_arc[1][-1])

    def house_place(self, a: ArrayLike) -> Floats:
        """Return the places q of domain coordinates."""
        q, arc = self._house_arc
        return np.asarray(np.interp(np.asarray(a, np.float64), arc, q))

    def house_a(self, q: ArrayLike) -> Floats:
        """Return the domain coordinates of places q."""
        places, arc = self._house_arc
        return np.asarray(np.interp(np.asarray(q, np.float64), places, arc))

    def roof_edge(self, q: ArrayLike) -> Floats:
        """Return the points of the roof's edge at places q, (M, 3)."""
        return np.asarray(self._house_lines[1](np.asarray(q, np.float64)))

    def house_side(self, y: ArrayLike) -> Floats:
        """Return the domain coordinates at which the base of the house's side is at ``y``."""
        d = self.design
        return self.house_a(1.0 + (np.asarray(y, np.float64) - d.rear_base) / (d.pillar_base - d.rear_base))

    def _roof_points(self, at: Floats) -> Floats:
        _, roof = self._house_lines
        q, u = self.house_place(at[:, 0]), -at[:, 1] / DECK
        edge = roof(q)
        edge[:, 0] = np.where((q <= 0.0) | (q >= 3.0), 0.0, np.maximum(edge[:, 0], 0.0))
        y0, y1 = roof(0.0)[1], roof(3.0)[1]
        y = edge[:, 1]
        crown = self._roof_crown(y, y0, y1)
        side = np.clip(edge[:, 0] / self.design.rail[0], 0.0, 1.0)
        lift = (crown - edge[:, 2]) * (1.0 - np.abs(u) ** 2.6) * np.minimum(side * 1.6, 1.0)
        return np.column_stack([edge[:, 0] * u, y, edge[:, 2] + lift])

    def _roof_crown(self, y: Floats, y0: float, y1: float) -> Floats:
        _, roof = self._house_lines
        z0, z1 = float(roof(0.0)[2]), float(roof(3.0)[2])
        f = np.clip((y - y0) / (y1 - y0), 0.0, 1.0)
        top = self.design.height
        # through both ends, highest a third behind the front
        arch = smooth([0.0, 0.3, 0.66, 1.0], [z0, top - 0.022, top, z1])
        return np.asarray(arch(f))

    @cached_property
    def roof(self) -> Master:
        """Return the roof between the two upper edges of the house."""
        q = np.unique(
            np.concatenate(
                [
                    np.linspace(0, 0.8, 6),
                    np.linspace(0.8, 1.1, 6),
                    np.linspace(1.1, 1.9, 9),
                    np.linspace(1.9, 2.2, 6),
                    np.linspace(2.2, 3.0, 6),
                ]
            )
        )
        u = np.array([-1, -0.93, -0.8, -0.5, 0, 0.5, 0.8, 0.93, 1.0])
        top = Master(self._roof_points, (0.0, -DECK), (self.house_length, DECK), (self.house_a(q), DECK * u))
        return self._detailed(top)


def roof_place(shell: Shell, x: float, y: float) -> Floats:
    """Return the point of the roof, (3,), at (x, y)."""
    q = np.linspace(1.0, 2.0, 60)
    edge = shell.roof_edge(q)
    where = float(np.interp(y, edge[:, 1], q))
    half = float(np.interp(y, edge[:, 1], edge[:, 0]))
    at = np.array([[float(shell.house_a(where)), -DECK * min(abs(x) / half, 1.0)]])
    return np.asarray(shell.roof.points(at)[0] * [np.sign(x), 1.0, 1.0])


def _fall(share: Floats) -> Floats:
    """Return a smooth step from 0 at 0 to 1 from 1 on."""
    t = np.clip(share, 0.0, 1.0)
    return np.asarray(t * (2.0 - t))


def _rounded_corners(line: Floats, reach: int) -> Floats:
    """Return a triangular moving average, with the ends mirrored in x."""
    flip = np.array([-1.0, 1.0, 1.0])
    padded = np.concatenate([line[1 : reach + 1][::-1] * flip, line, line[-reach - 1 : -1][::-1] * flip])
    weights = 1.0 - np.abs(np.arange(-reach, reach + 1)) / (reach + 1.0)
    weights /= weights.sum()
    return np.column_stack([np.convolve(padded[:, k], weights, "valid") for k in range(3)])


def extended(shape: BaseGeometry, frame: BaseGeometry) -> BaseGeometry:
    """Return the shape with its mirror images across the frame's borders that it touches, which are then not edges."""
    x0, y0, x1, y1 = frame.bounds
    pieces = [shape]
    for axis, border in ((0, x0), (0, x1), (1, y0), (1, y1)):
        near = shapely.box(
            *((border - 0.3, y0, border + 0.3, y1) if axis == 0 else (x0, border - 0.3, x1, border + 0.3))
        )
        strip = shapely.intersection(shape, near)
        if (
            strip.is_empty
            or abs((strip.bounds[axis] if border in (x0, y0) else strip.bounds[axis + 2]) - border) > 1e-6
        ):
            continue
        flip = np.array([-1.0, 1.0] if axis == 0 else [1.0, -1.0])
        move = np.array([2.0 * border, 0.0] if axis == 0 else [0.0, 2.0 * border])
        pieces.append(shapely.transform(strip, lambda p, f=flip, m=move: p * f + m))
    return shapely.union_all(pieces, grid_size=1e-7) if len(pieces) > 1 else shape


def rounded(shape: BaseGeometry, radius: float, frame: BaseGeometry) -> BaseGeometry:
    """Return the shape with corners rounded by ``radius`` (domain units), except at the frame's border."""
    wide = (
        extended(shape, frame).buffer(-radius, quad_segs=4).buffer(2 * radius, quad_segs=4).buffer(-radius, quad_segs=4)
    )
    return shapely.intersection(wide.simplify(0.001), frame)


def shrunk(shape: BaseGeometry, gap: float, frame: BaseGeometry) -> BaseGeometry:
    """Return the shape without a margin of ``gap``, except at the frame's border."""
    smaller = extended(shape, frame).buffer(-gap, join_style="mitre", mitre_limit=2.0).simplify(0.001)
    return shapely.intersection(smaller, frame)
