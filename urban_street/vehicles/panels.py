"""A car's sheet metal, glass and lamps, from outlines on the master surfaces, one part per panel."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import ArrayLike
from shapely.geometry.base import BaseGeometry

from urban_street.solids.surfaces import Bag, Floats, Surface, lathe, merge
from urban_street.vehicles.designs import CarDesign
from urban_street.vehicles.shell import DECK, HOUSE, Shell, rounded, shrunk
from urban_street.vehicles.skin import Master, Patch, cut, flange, reversed_
from urban_street.vehicles.windows import BODY, FRONT_DOOR, REAR_DOOR, Windows

#: Half the width and the depth of a gap between panels, metres.
_GAP = 0.0035
_DEPTH = 0.018
#: Thickness of a door, metres.
_DOOR = 0.065


@dataclass(slots=True)
class Half:
    """The surfaces of the half x ≥ 0 by part. Those that cross the middle are in ``both``."""

    parts: dict[str, Bag] = field(default_factory=lambda: {name: Bag() for name in (BODY, FRONT_DOOR, REAR_DOOR)})
    both: Bag = field(default_factory=Bag)


class Panels:
    """The panels of a shell."""

    def __init__(self, shell: Shell) -> None:
        self.shell = shell
        self.design: CarDesign = shell.design
        self.half = Half()

    def build(self) -> Half:
        self._ring()
        self._deck()
        self._house()
        if self.design.back != "open":
            self._roof()
        return self.half

    def _edge(self, patch: Patch, depth: float) -> Surface:
        """Build the edge of a panel; empty for distant views."""
        return flange(patch, depth) if self.shell.fine else merge([])

    def _border(self, master: Master, region: BaseGeometry, depth: float) -> Surface:
        """Build the edge of a region that is not a panel; empty, and not cut, for distant views."""
        return self._edge(cut(master, region), depth) if self.shell.fine else merge([])

    # -- outlines -----------------------------------------------------------------------------------------------------

    @cached_property
    def _arches(self) -> BaseGeometry:
        shell, d = self.shell, self.design
        discs = []
        for axle in (d.rear_axle, d.front_axle):
            circle = shell.arch(axle)
            t = shell.outline.at_y(circle[:, 0])
            b = shell.rail_at(t, circle[:, 1])
            low = circle[:, 1] < np.interp(circle[:, 0], *np.array(d.sill).T)
            b[low] = -0.1
            discs.append(shapely.Polygon(np.column_stack([t, b])).buffer(0))
        return shapely.union_all(discs)

    def _door_outlines(self) -> list[BaseGeometry]:
        """Return the lower parts of the right front door, and of the rear door if any, in the ring's domain."""
        d, shell = self.design, self.shell
        front, middle, rear = d.doors
        belt = float(np.interp(0.0, *np.array(d.belt).T))
        sill = float(np.interp(0.0, *np.array(d.sill).T))
        low = sill + 0.075 * (belt - sill) + 0.025
        top = belt + 0.3
        first = [(front - 0.05, top), (front - 0.05, belt), (front, belt - 0.22), (front - 0.015, sill + 0.24),
                 (front - 0.07, low), (middle, low), (middle, belt), (middle - 0.01, top)]  # fmt: skip
        arch = d.arch + 0.075
        angle = np.radians(np.linspace(62.0, 8.0, 9))
        around = [(d.rear_axle + arch * np.cos(a), d.tyre + arch * np.sin(a)) for a in angle]
        start = around[0]
        second = [(middle, top), (middle, low), (around[-1][0] - 0.0, low), *reversed(around),
                  (rear - 0.13, max(start[1] + 0.12, belt - 0.16)), (rear - 0.16, belt), (rear - 0.17, top)]  # fmt: skip
        return [shell.side_polygon(first[::-1])] + ([] if d.two_doors else [shell.side_polygon(second)])

    def _bow(self, line: ArrayLike, *, front: bool, rounding: float = 0.02) -> BaseGeometry:
        return self.shell.bow_polygon(line, front=front, rounding=rounding)

    @cached_property
    def _sheet_metal(self) -> BaseGeometry:
        """Return the part of the ring that is built: all, or only that of the cab in front of a box."""
        ring, d = self.shell.ring, self.design
        if d.back != "box":
            return ring.domain
        return shapely.box(float(self.shell.outline.at_y(d.box[1] - 0.05)), 0.0, *ring.high)

    # -- flank, nose and tail -----------------------------------------------------------------------------------------

    def _ring(self) -> None:
        shell, d, body = self.shell, self.design, self.half.parts[BODY]
        ring = shell.ring
        metal = self._sheet_metal.difference(self._arches)
        head = self._bow(d.head, front=True, rounding=0.025)
        tail = self._bow(d.tail_lamp, front=False, rounding=0.025)
        grille = self._bow(d.grille, front=True, rounding=0.015)
        intake = self._bow(d.intake, front=True, rounding=0.02)
        diffuser = self._bow([(0.0, 0.6), (0.80, 0.6), (0.76, 2.35), (0.0, 2.35)], front=False, rounding=0.03)
        cut_out = shapely.union_all([head, tail, grille, intake])
        seen_into = shapely.union_all([head, grille, intake]).buffer(-0.008)
        self._lamp(head, front=True)
        if d.back != "box":
            self._lamp(tail, front=False)
        self._grille(grille, bars=d.bars[0], chrome=True)
        self._grille(intake, bars=d.bars[1], chrome=False)
        sill_top = float(shell.height_of(2.2 if d.cladding else 0.9))
        low = shapely.box(0.0, 0.0, shell.outline.length, sill_top)
        plastic = low.union(self._arches.buffer(0.05)) if d.cladding else low
        plastic = plastic.union(diffuser)
        # Earlier panels take precedence where outlines overlap.
        doors = self._door_outlines()
        outlines: list[BaseGeometry] = []
        bumpers = [self._front_bumper(), self._rear_bumper(), self._tailgate()]
        for name, outline in zip((FRONT_DOOR, REAR_DOOR), doors, strict=False):
            panel = outline.intersection(metal).difference(shapely.union_all([*outlines, cut_out]))
            outlines.append(outline)
            self._door(name, shrunk(panel, _GAP, ring.domain), plastic)
        for outline in bumpers:
            panel = outline.intersection(metal).difference(shapely.union_all([*outlines, cut_out]))
            outlines.append(outline)
            self._metal(body, ring, shrunk(panel, _GAP, ring.domain), plastic)
        rest = metal.difference(shapely.union_all([*outlines, cut_out]))
        flap = shell.side_polygon(self._flap)
        self._metal(body, ring, shrunk(rest.difference(flap), _GAP, ring.domain), plastic)
        self._metal(body, ring, shrunk(flap.intersection(metal), _GAP, ring.domain), plastic)
        # the bottom of the gaps
        body.add("vehicle-gap", cut(ring.coarse(), metal.difference(seen_into).simplify(0.01), offset=-_DEPTH).surface)

    @property
    def _flap(self) -> Floats:
        """Return the filler flap. It is on both sides, which no view shows together."""
        d = self.design
        y, z = d.rear_axle + 0.10, d.tyre + d.arch + 0.11
        angle = np.linspace(0.0, 2.0 * np.pi, 21)[:-1]
        square = (
            np.sign(np.cos(angle)) * np.abs(np.cos(angle)) ** 0.5,
            np.sign(np.sin(angle)) * np.abs(np.sin(angle)) ** 0.5,
        )
        return np.column_stack([y + 0.075 * square[0], z + 0.065 * square[1]])

    def _front_bumper(self) -> BaseGeometry:
        """Return the nose skin below the bonnet, back to the wheel arches."""
        shell, d = self.shell, self.design
        edge = shell.side(
            [
                (d.front_axle + 0.6 * d.arch, d.tyre + d.arch * 0.86),
                (0.5 * d.length - 0.62, 0.62 * self._nose_top + 0.10),
            ]
        )
        lamp = shell.bow([(1.30, 5.6), (1.0, 5.4)], front=True)
        upper = shell.bow([(0.98, 6.3), (0.5, 7.0), (0.0, 7.25)], front=True)
        bottom = [(shell.outline.length, -0.1), (edge[0, 0], -0.1)]
        return shapely.Polygon(np.concatenate([edge, lamp, upper, bottom])).buffer(0)

    @property
    def _nose_top(self) -> float:
        return float(self.design.belt[-1][1])

    def _rear_bumper(self) -> BaseGeometry:
        shell, d = self.shell, self.design
        edge = shell.side(
            [(d.rear_axle - 0.75 * d.arch, d.tyre + d.arch * 0.66), (-0.5 * d.length + 0.42, d.tyre + d.arch * 0.72)]
        )
        lamp = shell.bow([(1.16, 5.15), (0.9, 4.9), (0.84, 4.35), (0.0, 4.3)], front=False)
        bottom = [(0.0, -0.1), (edge[0, 0], -0.1)]
        return shapely.Polygon(np.concatenate([edge, lamp, bottom])).buffer(0)

    def _tailgate(self) -> BaseGeometry:
        low, wide = (4.3, 0.84) if self.design.hatch else (4.6, 0.80)
        line = [(-0.1, low), (wide, low), (wide + 0.02, 6.0), (wide - 0.02, 8.3), (-0.1, 8.3)]
        return shapely.Polygon(self.shell.bow(line, front=False)).buffer(0)

    def _metal(self, bag: Bag, master: Master, region: BaseGeometry, plastic: BaseGeometry | None = None) -> None:
        """Add a panel with an edge. The part inside ``plastic`` is unpainted."""
        painted = region if plastic is None else region.difference(plastic)
        for material, piece in (
            ("paint", painted),
            ("vehicle-plastic", region.intersection(plastic) if plastic is not None else None),
        ):
            if piece is not None and not piece.is_empty:
                self._coat(bag, master, material, piece)
        bag.add("vehicle-gap", self._border(master.coarse(), region.simplify(0.003), _DEPTH))

    def _coat(self, bag: Bag, master: Master, material: str, piece: BaseGeometry) -> None:
        """Add sheet metal. On the ring, fields of a livery take the place of paint."""
        if material == "paint" and master is self.shell.ring:
            for other, field in self._livery:
                bag.add(other, cut(master, piece.intersection(field)).surface)
                piece = piece.difference(field)
        bag.add(material, cut(master, piece).surface)

    @cached_property
    def _livery(self) -> list[tuple[str, BaseGeometry]]:
        """Return the material and the place of each coloured field."""
        at, height = self.shell.outline.at_y, self.shell.height_of
        fields = []
        for material, y0, y1, low, high in self.design.livery:
            fields.append(
                (material, shapely.box(float(at(y0)), float(height(low)), float(at(y1)), float(height(high))))
            )
        return fields

    def _door(self, name: str, region: BaseGeometry, plastic: BaseGeometry) -> None:
        bag = self.half.parts[name]
        for material, piece in (
            ("paint", region.difference(plastic)),
            ("vehicle-plastic", region.intersection(plastic)),
        ):
            self._coat(bag, self.shell.ring, material, piece)
        bag.add("paint", self._border(self.shell.ring.coarse(2), region.simplify(0.003), _DOOR))
        bag.add(
            "vehicle-interior", reversed_(cut(self.shell.ring.coarse(2), region.simplify(0.02), offset=-_DOOR).surface)
        )

    def _lamp(self, region: BaseGeometry, *, front: bool) -> None:
        """Add a lens with its inner parts."""
        body, ring = self.half.parts[BODY], self.shell.ring
        inner = region.buffer(-0.004, quad_segs=2)
        a0, b0, a1, b1 = region.bounds
        if front:
            lens = cut(ring, inner)
            body.add("vehicle-lens", lens.surface)
            body.add("vehicle-plastic", reversed_(self._edge(lens, 0.055)))
            body.add("vehicle-lamp-housing", cut(ring, inner, offset=-0.055).surface)
            # a light guide along the lower edge, and two projectors
            guide = inner.difference(shapely.affinity.translate(inner, 0.0, 0.024)).buffer(-0.003)
            patch = cut(ring, guide, offset=-0.012)
            body.add("vehicle-lamp-white", patch.surface, self._edge(patch, 0.03))
            for share, radius in self.design.projectors if self.shell.fine else ():
                at = _inside(inner, a1 - share * (a1 - a0))
                self._projector(at, radius)
            return
        light = inner.buffer(-0.012)
        band = shapely.box(a0, b0 + 0.22 * (b1 - b0), a1, b0 + 0.40 * (b1 - b0))
        bright = (
            light.difference(light.buffer(-0.022))
            .union(light.intersection(shapely.box(a0, b0 + 0.62 * (b1 - b0), a1, b0 + 0.74 * (b1 - b0))))
            .difference(band)
        )
        white = light.intersection(band).intersection(shapely.box(a0, b0, a0 + 0.6 * (a1 - a0), b1)).buffer(-0.004)
        dark = inner.difference(bright).difference(white)
        body.add("vehicle-lamp-red", cut(ring, bright).surface)
        body.add("vehicle-lamp-clear", cut(ring, white).surface)
        body.add("vehicle-lamp-dark-red", cut(ring, dark).surface)
        body.add("vehicle-plastic", self._border(ring, inner, 0.02))

    def _projector(self, at: Floats, radius: float) -> None:
        """Add a lens in a bright ring that faces forwards."""
        body, ring = self.half.parts[BODY], self.shell.ring
        centre = ring.points(at[None])[0] - ring.normals(at[None])[0] * 0.048
        rim = lathe([(radius * 0.62, 0.004), (radius, 0.034), (radius * 1.08, 0.034), (radius * 1.08, 0.0)][::-1], 18)
        eye = lathe([(radius * 0.64, 0.004), (radius * 0.45, 0.016), (0.0, 0.022)], 14)
        turn = np.eye(4)
        turn[:3, :3] = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
        turn[:3, 3] = centre
        body.add("vehicle-chrome", rim.moved(turn))
        body.add("vehicle-lamp-white", eye.moved(turn))

    def _grille(self, region: BaseGeometry, *, bars: int, chrome: bool) -> None:
        """Add a dark opening with bars across (upright: a negative number), and a frame. Without bars it is closed."""
        body, ring = self.half.parts[BODY], self.shell.ring
        if not bars:
            body.add("vehicle-black-gloss", cut(ring, region.buffer(-0.002)).surface)
            return
        body.add("vehicle-gap", cut(ring, region, offset=-0.05).surface, reversed_(self._border(ring, region, 0.05)))
        _, b0, _, b1 = region.bounds
        a0, a1 = region.bounds[0], region.bounds[2]
        upright, count = bars < 0, abs(bars)
        span = a1 - a0 if upright else b1 - b0
        thick = min(0.012, 0.3 * span / count)
        for k in range(count if self.shell.fine else 0):
            middle = (a0 if upright else b0) + (k + 0.5) * span / count
            low, high = middle - 0.5 * thick, middle + 0.5 * thick
            strip = (low, b0 - 1, high, b1 + 1) if upright else (a0 - 1, low, a1 + 1, high)
            bar = region.intersection(shapely.box(*strip))
            patch = cut(ring, bar, offset=-0.010)
            body.add("vehicle-black-gloss", patch.surface, self._edge(patch, 0.02))
        frame = region.difference(region.buffer(-0.014)) if chrome else region.difference(region.buffer(-0.010))
        middle = shapely.box(self.shell.outline.length - 0.05, b0 + 0.014, self.shell.outline.length + 1, b1 - 0.014)
        frame = frame.difference(middle)
        patch = cut(ring, frame, offset=0.004)
        body.add("vehicle-chrome" if chrome else "vehicle-plastic", patch.surface, self._edge(patch, 0.02))

    # -- bonnet and boot ----------------------------------------------------------------------------------------------

    def _deck(self) -> None:
        shell, d, both = self.shell, self.design, self.half.both
        deck = shell.deck
        u = np.linspace(-1.0, 1.0, 41)
        # the bonnet's end, from pillar to pillar ahead of the windscreen
        cowl = shell.deck_t(d.pillar_base + (d.cowl - d.pillar_base) * (1.0 - np.abs(u) ** 2.2) + 0.075)
        nose = shell.outline.length
        seam = 0.935 * DECK
        ahead = shapely.Polygon(np.concatenate([np.column_stack([cowl, DECK * u]), [(nose, DECK), (nose, -DECK)]]))
        corner = float(shell.deck_t(0.5 * d.length - 0.50))
        side = [(0.0, -seam), (corner, -seam), (corner + 0.25, -DECK), (nose + 0.1, -DECK), (nose + 0.1, DECK),
                (corner + 0.25, DECK), (corner, seam), (0.0, seam)]  # fmt: skip
        bonnet = ahead.intersection(shapely.Polygon(side))
        fenders = ahead.difference(shapely.Polygon(side))
        self._metal(both, deck, shrunk(bonnet, _GAP, deck.domain))
        self._metal(both, deck, shrunk(fenders, 0.5 * _GAP, deck.domain))
        both.add("vehicle-gap", cut(deck.coarse(2), ahead, offset=-0.02).surface)
        # plastic cowl below the wipers, and the shelf beside the glass
        behind = shapely.box(float(shell.deck_t(d.rear_base + 0.05)), -DECK, nose, DECK).difference(ahead)
        sides = behind.difference(
            shapely.box(0.0, -0.80 * DECK, float(shell.deck_t(d.pillar_base - 0.12)), 0.80 * DECK)
        )
        ledge = shapely.box(0.0, -DECK, float(shell.deck_t(d.pillar_base - 0.1)), DECK)
        both.add("vehicle-plastic", cut(deck, sides.difference(ledge)).surface)
        both.add("paint", cut(deck, sides.intersection(ledge)).surface)
        # boot lid, or the ledge below the rear window
        rear = shapely.box(0.0, -DECK, float(shell.deck_t(d.rear_base + 0.06)), DECK)
        if d.back == "box":
            return
        if d.back == "bed":
            self._metal(both, deck, rear.difference(self._bed))
            return
        if d.hatch:
            both.add("paint", cut(deck, rear).surface)
            return
        wide = 0.90 * DECK
        lid = rear.intersection(shapely.box(0.0, -wide, nose, wide))
        self._metal(both, deck, shrunk(lid, _GAP, deck.domain))
        self._metal(both, deck, shrunk(rear.difference(lid), 0.5 * _GAP, deck.domain))
        both.add("vehicle-gap", cut(deck.coarse(2), rear, offset=-0.02).surface)

    @cached_property
    def _bed(self) -> BaseGeometry:
        """Return the opening of a pick-up's bed in the deck."""
        y0, y1, half = self.design.bed
        wide = DECK * half / (0.5 * self.design.width)
        return shapely.box(float(self.shell.deck_t(y0)), -wide, float(self.shell.deck_t(y1)), wide)

    # -- glass house --------------------------------------------------------------------------------------------------

    def _house(self) -> None:
        house, windows = self.shell.house, Windows(self.shell)
        panes = windows.panes()
        every_pane = [pane for group in panes.values() for pane in group]
        blank, black = shapely.union_all(every_pane), windows.blackened(every_pane)
        doors = windows.door_frames()
        openings = shapely.union_all(list(doors.values()))
        shapes = {name: shrunk(door, _GAP, house.domain) for name, door in doors.items()}
        shapes[BODY] = house.domain.difference(openings.buffer(_GAP))
        if self.design.back == "open":  # only the frame of the windscreen
            front = shapely.box(float(self.shell.house_a(2.0)) - 0.03, -1.0, 9.0, 0.99 * HOUSE)
            shapes[BODY] = rounded(front.intersection(house.domain), 0.03, house.domain)
        for name, shape in shapes.items():
            bag = self.half.parts[name]
            frame = shape.difference(blank)
            bag.add("paint", cut(house, frame.difference(black)).surface)
            bag.add("vehicle-black-gloss", cut(house, frame.intersection(black)).surface)
            bag.add("vehicle-gap", self._border(house.coarse(2), frame.simplify(0.003), 0.03))
            bag.add("vehicle-trim", reversed_(cut(house.coarse(2), frame.simplify(0.008), offset=-0.03).surface))
            for pane in panes[name]:
                behind = pane.buffer(0.002, quad_segs=2).intersection(house.domain)
                bag.add("vehicle-glass", cut(house, behind, offset=-0.003).surface)
        seam = openings.buffer(0.01).difference(openings.buffer(-0.012)).difference(blank.buffer(0.01))
        self.half.parts[BODY].add("vehicle-gap", cut(house, seam, offset=-0.02).surface)

    # -- roof ---------------------------------------------------------------------------------------------------------

    def _roof(self) -> None:
        roof, both = self.shell.roof, self.half.both
        both.add(self.design.roof, cut(roof, roof.domain).surface)
        both.add("vehicle-trim", reversed_(cut(roof.coarse(2), roof.domain, offset=-0.035).surface))


def _inside(region: BaseGeometry, a: float) -> Floats:
    """Return the middle of a region at the first coordinate ``a``."""
    _, b0, _, b1 = region.bounds
    line = region.intersection(shapely.LineString([(a, b0 - 1.0), (a, b1 + 1.0)]))
    low, high = line.bounds[1], line.bounds[3]
    return np.array([a, 0.5 * (low + high)])
