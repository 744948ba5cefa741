"""Designs of car bodies in numbers: proportions, plan, sections and glass."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final, Literal

Line = tuple[tuple[float, float], ...]
#: Nine rails from the sill to the belt: (metres inside the plan outline, share of the height from sill to belt).
Section = tuple[tuple[float, float], ...]


@dataclass(frozen=True, slots=True)
class CarDesign:
    """One body. Metres; y from the middle of the length to the front, z from the road.

    Attributes:
        length, width, height: size without mirrors, extras and box.
        front_axle, rear_axle: y of the wheel centres.
        tyre: outer radius of the wheels.
        arch: radius of the wheel arches.
        sill: (y, z) of the lower edge of the body.
        belt: (y, z) of the upper edge: boot, belt, bonnet.
        tail_plan, nose_plan: (share of the half width, metres from the end) of the plan outline, middle to flank.
        sections: name of a place to section: tail, tail-corner, rear, middle, front, nose-corner, nose.
        cowl: y of the middle of the windscreen's lower edge.
        pillar_base, pillar_top: y of the front pillar's outside at the belt and at the roof.
        roof_front, roof_rear: y of the roof's front and rear edge in the middle.
        rear_top: y of the rear pillar's outside at the roof.
        glass_tail: y of the middle of the rear window's lower edge.
        rear_base: y of the rear pillar's outside at the belt.
        rail: (half width, z) of the roof's side edge.
        bonnet_crown, boot_crown: height of the middle above the edges.
        posts: (y at the belt, y at the roof) of the posts between the side windows, front to rear.
        doors: y of the front edge of the front doors, of the middle gap, and of the rear doors' end.
        quarter: (y at the belt, y at the roof) of the glass's rear end.
        hatch: True if the tail opens with the rear window, without a boot lid.
        head, tail_lamp, grille, intake: outlines on nose and tail, for the half x ≥ 0: (share of the half width along the bow,
            rail) corners; rails as in `Section`, from 0 to 8.
        plate: rail of the number plate's middle, front and rear.
        roof_rails: True if there are bars along the roof.
        cladding: True if lower edge and arches are unpainted.
        panel_van: True if there are no side windows behind the front doors.
        glass_top: upper edges of all panes, by the usual share of the way from belt to roof.
        two_doors: True if there are no rear doors.
        back: what is behind the doors: ``closed``; ``open``, a cabin without a roof; ``bed``, a pick-up's; ``box``, a body of
            its own (`box`).
        box: of a separate body: (y of tail and front, width, z of floor and top, y to which it reaches above the cab).
        rims: designs of rims, of which a seed chooses one.
        tyre_width, rim_share: width of the tyres, metres; radius of the rims by that of the tyres.
        projectors: (share of the lamp's width from its outside, radius) of the projectors in a head lamp.
        bars: bars of grille and intake; no grille bars for a closed front, negative for upright ones.
        roof: material of the roof.
        fin: True if there is an aerial like a fin on the roof.
        livery: coloured fields on the flanks: (material, y from, y to, rail from, rail to).
        extras: names of `urban_street.vehicles.extras.EXTRAS`.
        beyond: by how much extras, or a box, lengthen each end and heighten the whole, metres.
    """

    name: str
    length: float
    width: float
    height: float
    front_axle: float
    rear_axle: float
    tyre: float
    arch: float
    sill: Line
    belt: Line
    tail_plan: Line
    nose_plan: Line
    sections: dict[str, Section]
    cowl: float
    pillar_base: float
    pillar_top: float
    roof_front: float
    roof_rear: float
    rear_top: float
    glass_tail: float
    rear_base: float
    rail: tuple[float, float]
    bonnet_crown: float
    boot_crown: float
    posts: Line
    doors: tuple[float, float, float]
    quarter: tuple[float, float]
    hatch: bool
    head: Line
    tail_lamp: Line
    grille: Line
    intake: Line
    plate: tuple[float, float]
    roof_rails: bool = False
    cladding: bool = False
    panel_van: bool = False
    glass_top: float = 1.0
    two_doors: bool = False
    back: Literal["closed", "open", "bed", "box"] = "closed"
    box: tuple[float, float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    rims: tuple[str, ...] = ("five", "double", "ten", "star", "turbine", "steel")
    tyre_width: float = 0.215
    rim_share: float = 0.70
    projectors: Line = ((0.34, 0.048), (0.58, 0.042))
    bars: tuple[int, int] = (5, 4)
    roof: str = "paint"
    fin: bool = True
    livery: tuple[tuple[str, float, float, float, float], ...] = ()
    extras: tuple[str, ...] = ()
    beyond: tuple[float, float] = (0.0, 0.0)

    @property
    def size(self) -> tuple[float, float, float]:
        """Return overall length, width (without mirrors) and height."""
        wide = max(self.width, self.box[2])
        return self.length + 2.0 * self.beyond[0], wide, self.height + self.beyond[1]

    @property
    def early(self) -> bool:
        """Return True for the bodies of the first street, whose bits are kept. Their flaws go when its revision is raised."""
        return self.name in EARLY

    @property
    def bed(self) -> tuple[float, float, float]:
        """Return y of tail and front, and half the width, of a pick-up's bed."""
        return 0.10 - 0.5 * self.length, self.glass_tail - 0.10, 0.5 * self.width - 0.14


#: The bodies of the first street.
EARLY: Final = ("hatchback", "sedan", "estate", "suv", "van")

_NOSE_PLAN: Final = ((0.0, 0.0), (0.40, 0.03), (0.68, 0.115), (0.86, 0.29), (0.945, 0.60), (0.98, 1.05))
_TAIL_PLAN: Final = ((0.0, 0.0), (0.50, 0.018), (0.78, 0.07), (0.92, 0.20), (0.97, 0.50), (1.0, 1.25))

_SECTIONS: Final[dict[str, Section]] = {
    "tail": ((0.13, 0.0), (0.05, 0.02), (0.012, 0.10), (0.0, 0.27), (0.008, 0.42), (0.040, 0.52), (0.046, 0.74),
             (0.062, 0.93), (0.10, 1.0)),
    "tail-corner": ((0.13, 0.0), (0.05, 0.02), (0.012, 0.10), (0.0, 0.27), (0.006, 0.42), (0.024, 0.56),
                    (0.028, 0.78), (0.05, 0.94), (0.09, 1.0)),
    "rear": ((0.14, 0.0), (0.045, 0.02), (0.018, 0.10), (0.016, 0.28), (-0.004, 0.52), (0.006, 0.78), (0.028, 0.91),
             (0.046, 0.975), (0.075, 1.0)),
    "middle": ((0.14, 0.0), (0.05, 0.02), (0.026, 0.10), (0.042, 0.28), (0.006, 0.56), (0.006, 0.80), (0.030, 0.92),
               (0.046, 0.98), (0.072, 1.0)),
    "front": ((0.14, 0.0), (0.05, 0.02), (0.020, 0.11), (0.020, 0.30), (0.000, 0.57), (0.006, 0.79), (0.034, 0.915),
              (0.066, 0.97), (0.125, 1.0)),
    "nose-corner": ((0.12, 0.0), (0.035, 0.025), (0.006, 0.13), (0.0, 0.36), (0.004, 0.57), (0.022, 0.74),
                    (0.050, 0.88), (0.085, 0.955), (0.15, 1.0)),
    "nose": ((0.12, 0.0), (0.030, 0.025), (0.002, 0.13), (0.0, 0.36), (0.006, 0.57), (0.026, 0.74), (0.054, 0.88),
             (0.090, 0.955), (0.16, 1.0)),
}  # fmt: skip

HATCHBACK: Final = CarDesign(
    name="hatchback", length=4.28, width=1.79, height=1.47, front_axle=1.27, rear_axle=-1.36, tyre=0.318, arch=0.362,
    sill=((-2.14, 0.27), (-1.9, 0.235), (-1.0, 0.19), (1.0, 0.185), (1.8, 0.195), (2.14, 0.20)),
    belt=((-2.14, 0.985), (-1.6, 0.985), (-0.8, 0.955), (0.3, 0.925), (0.9, 0.915), (1.3, 0.885), (1.7, 0.835),
          (1.95, 0.785), (2.14, 0.735)),
    tail_plan=_TAIL_PLAN, nose_plan=_NOSE_PLAN, sections=_SECTIONS,
    cowl=1.12, pillar_base=0.86, pillar_top=0.06, roof_front=0.22, roof_rear=-1.72, rear_top=-1.60,
    glass_tail=-2.02, rear_base=-1.90, rail=(0.635, 1.375), bonnet_crown=0.085, boot_crown=0.02,
    posts=((-0.26, -0.34), (-1.08, -1.10)), doors=(0.93, -0.20, -1.08), quarter=(-1.42, -1.24), hatch=True,
    head=((0.50, 5.45), (0.99, 6.25), (1.34, 6.9), (1.36, 6.2), (1.08, 4.95), (0.72, 4.6), (0.52, 4.75)),
    tail_lamp=((0.55, 5.35), (0.98, 5.1), (1.20, 5.2), (1.26, 6.85), (1.0, 6.8), (0.62, 6.6)),
    grille=((0.0, 4.75), (0.47, 4.9), (0.46, 5.45), (0.0, 5.35)),
    intake=((0.0, 1.6), (0.62, 1.7), (0.72, 2.3), (0.56, 3.4), (0.0, 3.4)),
    plate=(3.75, 5.75),
)  # fmt: skip

SEDAN: Final = replace(
    HATCHBACK, name="sedan", length=4.72, width=1.84, height=1.44, front_axle=1.50, rear_axle=-1.33, tyre=0.325,
    arch=0.37,
    sill=((-2.36, 0.29), (-2.05, 0.235), (-1.0, 0.185), (1.2, 0.18), (2.0, 0.185), (2.36, 0.19)),
    belt=((-2.36, 0.99), (-2.1, 1.005), (-1.6, 0.985), (-0.8, 0.945), (0.4, 0.915), (1.0, 0.905), (1.5, 0.868),
          (1.95, 0.81), (2.2, 0.755), (2.36, 0.70)),
    cowl=1.22, pillar_base=0.98, pillar_top=0.16, roof_front=0.30, roof_rear=-1.17, rear_top=-1.06, glass_tail=-1.78,
    rear_base=-1.62, rail=(0.635, 1.345), bonnet_crown=0.08, boot_crown=0.035,
    posts=((-0.16, -0.26), (-1.00, -0.82)), doors=(1.05, -0.10, -1.04), quarter=(-1.34, -0.94), hatch=False,
    grille=((0.0, 4.25), (0.42, 4.35), (0.50, 5.45), (0.0, 5.6)),
    tail_lamp=((0.50, 5.3), (0.98, 5.2), (1.26, 5.5), (1.30, 6.6), (1.0, 6.7), (0.56, 6.55)),
    plate=(3.75, 5.6),
)  # fmt: skip

ESTATE: Final = replace(
    SEDAN, name="estate", height=1.49,
    belt=((-2.36, 1.0), (-2.1, 1.0), (-1.6, 0.985), (-0.8, 0.95), (0.4, 0.92), (1.0, 0.905), (1.5, 0.868),
          (1.95, 0.81), (2.2, 0.755), (2.36, 0.70)),
    roof_rear=-1.92, rear_top=-1.84, glass_tail=-2.24, rear_base=-2.12, rail=(0.64, 1.395),
    posts=((-0.16, -0.26), (-1.06, -1.10)), doors=(1.05, -0.10, -1.08), quarter=(-1.94, -1.70), hatch=True,
    tail_lamp=((0.60, 5.35), (0.98, 5.1), (1.22, 5.2), (1.26, 6.85), (1.0, 6.8), (0.66, 6.6)), roof_rails=True,
)  # fmt: skip

SUV: Final = replace(
    HATCHBACK, name="suv", length=4.48, width=1.86, height=1.66, front_axle=1.36, rear_axle=-1.32, tyre=0.352,
    arch=0.405,
    sill=((-2.24, 0.34), (-1.95, 0.29), (-1.0, 0.24), (1.1, 0.24), (1.9, 0.26), (2.24, 0.275)),
    belt=((-2.24, 1.12), (-1.6, 1.10), (-0.8, 1.07), (0.4, 1.045), (0.95, 1.04), (1.4, 1.02), (1.8, 0.985),
          (2.05, 0.935), (2.24, 0.875)),
    cowl=1.12, pillar_base=0.88, pillar_top=0.12, roof_front=0.28, roof_rear=-1.86, rear_top=-1.74,
    glass_tail=-2.10, rear_base=-1.98, rail=(0.665, 1.555), bonnet_crown=0.075, boot_crown=0.02,
    posts=((-0.24, -0.32), (-1.10, -1.12)), doors=(0.96, -0.18, -1.10), quarter=(-1.74, -1.52), hatch=True,
    grille=((0.0, 4.0), (0.50, 4.05), (0.52, 5.4), (0.0, 5.5)), plate=(3.3, 5.5), roof_rails=True, cladding=True,
)  # fmt: skip

VAN: Final = replace(
    HATCHBACK, name="van", length=5.02, width=1.96, height=1.99, front_axle=1.56, rear_axle=-1.46, tyre=0.345, arch=0.395,
    sill=((-2.5, 0.36), (-2.2, 0.31), (-1.0, 0.25), (1.2, 0.25), (2.2, 0.25), (2.5, 0.26)),
    belt=((-2.5, 1.14), (0.9, 1.14), (1.5, 1.125), (1.8, 1.10), (2.1, 1.03), (2.3, 0.96), (2.5, 0.88)),
    tail_plan=((0.0, 0.0), (0.55, 0.006), (0.86, 0.025), (0.955, 0.10), (0.985, 0.30), (1.0, 0.9)),
    cowl=1.86, pillar_base=1.62, pillar_top=0.98, roof_front=1.10, roof_rear=-2.36, rear_top=-2.30, glass_tail=-2.42,
    rear_base=-2.34, rail=(0.79, 1.87), bonnet_crown=0.07, boot_crown=0.0,
    posts=((0.62, 0.56), (-0.82, -0.84)), doors=(1.66, 0.66, -0.84), quarter=(-1.9, -1.9), hatch=True,
    head=((0.56, 5.35), (0.98, 5.6), (1.24, 6.9), (1.22, 7.2), (1.0, 7.0), (0.60, 6.35)),
    tail_lamp=((0.80, 4.6), (0.97, 4.6), (0.985, 6.9), (0.80, 6.9)), grille=((0.0, 5.2), (0.50, 5.3), (0.52, 6.3), (0.0, 6.3)),
    plate=(3.7, 5.3), panel_van=True,
)  # fmt: skip

#: The bodies of the first street by name, in the order of `EARLY`.
EARLY_CARS: Final = {design.name: design for design in (HATCHBACK, SEDAN, ESTATE, SUV, VAN)}
