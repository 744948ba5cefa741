"""The three body types that are parked in the street, in numbers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from valerie.scene.procedural.street.geometry import Floats

Line = tuple[tuple[float, float], ...]


@dataclass(frozen=True, slots=True)
class Face:
    """Where lamps, grille and plate sit: fractions of the half width, levels between sill (0) and belt (1).

    Attributes:
        grille: half width, lower and upper level.
        lamp, tail: inner and outer end, lower and upper level, how much the outer end is raised.
        rear_plate: lower and upper level.
    """

    grille: tuple[float, float, float]
    lamp: tuple[float, float, float, float, float]
    tail: tuple[float, float, float, float, float]
    rear_plate: tuple[float, float]


@dataclass(frozen=True, slots=True)
class CarShape:
    """One body type; metres, y from the middle towards the front.

    Attributes:
        length, width, height: over all, without mirrors.
        sill: ground clearance.
        wheel, arch: radii.
        rear_axle, front_axle: positions.
        belt_line: (y, z) points of the upper edge of the lower body: boot lid, belt, bonnet.
        crown: how much bonnet and boot rise towards the middle.
        nose: how far the nose leans back at the top (1 is a car's, less is a van's).
        cowl, tail: where windscreen and rear window meet the body.
        roof_front, roof_rear: where they meet the roof.
        belt_width, roof_width: of the glass house, as parts of the width.
        pillars: positions of the middle pillars' front and rear edges, front to rear.
        panes: for each piece of the flank between the corner pillars, front to rear: side, trim or panel.
        glazed: which kinds of pieces are glass.
        gaps: door gaps and shut lines, (y, z).
        handles: positions of the door handles.
        face: what nose and tail carry.
    """

    name: str
    length: float
    width: float
    height: float
    sill: float
    wheel: float
    arch: float
    rear_axle: float
    front_axle: float
    belt_line: Line
    crown: float
    nose: float
    cowl: float
    tail: float
    roof_front: float
    roof_rear: float
    belt_width: float
    roof_width: float
    pillars: tuple[float, ...]
    panes: tuple[str, ...]
    glazed: tuple[str, ...]
    gaps: tuple[Line, ...]
    handles: tuple[float, ...]
    face: Face

    @property
    def texture_length(self) -> float:
        """Metres that the flank's texture covers along the car."""
        return self.length + 0.1

    @property
    def texture_height(self) -> float:
        return self.height + 0.05

    def belt(self, y: Floats) -> Floats:
        """Height of the upper edge of the lower body."""
        line = np.array(self.belt_line)
        return np.asarray(np.interp(y, line[:, 0], line[:, 1]))

    @property
    def side_panes(self) -> tuple[str, ...]:
        """What lies between neighbouring `side_keys`."""
        return ("pillar", *self.panes, "pillar")

    def side_keys(self, front: tuple[float, float], rear: tuple[float, float]) -> list[tuple[float, float]]:
        """(y at the belt, y at the roof) of the grid lines of the glass house's flank, front corner to rear corner."""
        lines = [front, (front[0] - 0.085, front[1] - 0.085)]
        lines += [(y, y - 0.03) for y in self.pillars]
        lines += [(rear[0] + 0.16, rear[1] + 0.12), rear]
        return lines


_HATCH_GAPS: Final = (
    ((0.86, 0.30), (0.86, 0.62), (0.80, 0.93)),
    ((-0.23, 0.24), (-0.23, 0.93)),
    ((-0.92, 0.66), (-1.20, 0.90)),
    ((-0.92, 0.66), (-0.80, 0.40), (-0.80, 0.24), (0.86, 0.24)),
    ((-1.45, 0.76), (-1.45, 0.86), (-1.58, 0.86), (-1.58, 0.76), (-1.45, 0.76)),
)
_SALOON_GAPS: Final = (
    ((0.92, 0.30), (0.92, 0.62), (0.86, 0.92)),
    ((-0.20, 0.24), (-0.20, 0.92)),
    ((-0.98, 0.66), (-1.22, 0.90)),
    ((-0.98, 0.66), (-0.86, 0.40), (-0.86, 0.24), (0.92, 0.24)),
    ((-1.62, 0.76), (-1.62, 0.86), (-1.75, 0.86), (-1.75, 0.76), (-1.62, 0.76)),
)
_VAN_GAPS: Final = (
    ((1.35, 0.42), (1.35, 1.08)),
    ((0.42, 0.26), (0.42, 1.9)),
    ((0.42, 0.26), (1.35, 0.26)),
    ((-0.78, 0.26), (-0.78, 1.86)),
    ((-0.78, 0.26), (0.42, 0.26)),
    ((-0.78, 1.06), (-2.3, 1.06)),
)

HATCH: Final = CarShape(
    name="hatch", length=4.26, width=1.78, height=1.48, sill=0.20, wheel=0.315, arch=0.365, rear_axle=-1.32,
    front_axle=1.30,
    belt_line=((-2.2, 0.93), (-1.6, 0.955), (-0.4, 0.925), (0.9, 0.91), (1.1, 0.905), (1.75, 0.82), (2.0, 0.745),
        (2.15, 0.69)),
    crown=0.07, nose=1.0, cowl=1.16, tail=-1.96, roof_front=0.28, roof_rear=-1.60, belt_width=0.925, roof_width=0.71,
    pillars=(-0.17, -0.27, -1.10, -1.20), panes=("side", "trim", "side", "trim", "side"),
    glazed=("front", "rear", "side"),
    gaps=_HATCH_GAPS, handles=(-0.08, -1.02),
    face=Face(grille=(0.55, 0.68, 0.80), lamp=(0.55, 0.93, 0.68, 0.84, 0.03), tail=(0.68, 0.965, 0.68, 0.93, 0.0),
        rear_plate=(0.50, 0.65)),
)  # fmt: skip

SALOON: Final = CarShape(
    name="saloon", length=4.66, width=1.82, height=1.45, sill=0.19, wheel=0.32, arch=0.37, rear_axle=-1.40,
    front_axle=1.40,
    belt_line=((-2.35, 0.93), (-2.1, 0.985), (-1.5, 0.985), (-0.4, 0.925), (1.0, 0.905), (1.2, 0.895), (1.9, 0.80),
        (2.2, 0.725), (2.35, 0.67)),
    crown=0.06, nose=1.0, cowl=1.22, tail=-1.86, roof_front=0.30, roof_rear=-1.06, belt_width=0.92, roof_width=0.69,
    pillars=(-0.14, -0.24, -1.02, -1.10), panes=("side", "trim", "side", "trim", "side"),
    glazed=("front", "rear", "side"),
    gaps=_SALOON_GAPS, handles=(-0.05, -1.05),
    face=Face(grille=(0.42, 0.60, 0.82), lamp=(0.54, 0.93, 0.66, 0.81, 0.03), tail=(0.52, 0.965, 0.68, 0.86, 0.02),
        rear_plate=(0.34, 0.50)),
)  # fmt: skip

VAN: Final = CarShape(
    name="van", length=4.98, width=1.92, height=1.98, sill=0.22, wheel=0.335, arch=0.385, rear_axle=-1.50,
    front_axle=1.50,
    belt_line=((-2.5, 1.08), (1.2, 1.08), (1.75, 1.07), (2.1, 0.99), (2.35, 0.90), (2.5, 0.84)),
    crown=0.06, nose=0.85, cowl=1.98, tail=-2.33, roof_front=1.02, roof_rear=-2.24, belt_width=0.94, roof_width=0.83,
    pillars=(0.46, 0.36, -0.74, -0.82), panes=("side", "trim", "panel", "panel", "panel"),
    glazed=("front", "rear", "side"),
    gaps=_VAN_GAPS, handles=(0.55, -0.62),
    face=Face(grille=(0.50, 0.58, 0.76), lamp=(0.58, 0.93, 0.62, 0.82, 0.03), tail=(0.86, 0.985, 0.45, 0.98, 0.0),
        rear_plate=(0.40, 0.53)),
)  # fmt: skip

SHAPES: Final = {shape.name: shape for shape in (HATCH, SALOON, VAN)}
