"""The parts of a character: body, gait, clothes and colours; and the paper's two characters (others: `catalogue`)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

from urban_street.human import textures
from urban_street.human.body import BodyShape
from urban_street.human.clothing import Cut
from urban_street.human.drape import Fabric
from urban_street.human.hair import HairCut
from urban_street.human.hats import Hat
from urban_street.human.pose import Gait
from urban_street.human.shoes import ShoeCut
from urban_street.human.skin import Face
from urban_street.human.trim import Collar


@dataclass(frozen=True, slots=True, eq=False)
class Garment:
    """One garment.

    Attributes:
        name: name of its material after ``cloth-``.
        texture: paints its colour and relief.
        roughness, specular: material of the cloth.
        thickness: thickness of the hems, metres.
        over: True if it is worn over the garments before it.
    """

    name: str
    cut: Cut
    texture: Callable[[], textures.TextureCanvas]
    roughness: float
    specular: float
    thickness: float = 0.003
    collar: Collar | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Outfit:
    """The look of a character.

    Attributes:
        garments: garments from the inside out.
        shoe_texture, sole: texture of the shoes' uppers, and linear colour of the soles.
        hair: its hair; None for none.
        hair_colour: colour of the hair, sRGB.
        seed: seed of small irregularities.
        hat: hat over the hair.
        carries: one of `urban_street.human.stances.CARRIED` except ``own``.
        bag_colour, umbrella_colour: colours of the carried things, sRGB.
    """

    shape: BodyShape
    gait: Gait
    garments: tuple[Garment, ...]
    shoe: ShoeCut
    shoe_texture: Callable[[], textures.TextureCanvas]
    shoe_roughness: float
    sole: tuple[float, float, float]
    hair: HairCut | None
    hair_colour: textures.Colour
    face: Face
    seed: int
    hat: Hat | None = None
    carries: str = "nothing"
    bag_colour: textures.Colour = (92, 62, 40)
    umbrella_colour: textures.Colour = (28, 34, 66)


def black_outfit() -> Outfit:
    hairline = {
        0.0: 41.0,
        25.0: 40.0,
        42.0: 33.0,
        55.0: 20.0,
        64.0: 10.0,
        72.0: -12.0,
        80.0: -14.0,
        87.0: 3.0,
        108.0: 3.0,
        118.0: -12.0,
        180.0: -36.0,
    }
    return Outfit(
        shape=BodyShape(sex=1.0, age=0.55, muscle=0.52, weight=0.52, height=0.53, proportions=0.6),
        gait=Gait(phase=0.055, stride=0.86, arm_swing_deg=17.0, elbow_deg=22.0, arm_out_deg=14.0),
        garments=(
            Garment(
                "trousers",
                Cut(
                    "trousers",
                    upper=0.72,
                    lower=0.055,
                    ease=0.009,
                    tube={0.25: 0.092, 1.0: 0.085, 2.0: 0.080},
                    fabric=Fabric(bending=0.14),
                ),
                partial(textures.trousers, (32, 32, 36), 11),
                roughness=0.85,
                specular=0.7,
            ),
            Garment(
                "jacket",
                Cut(
                    "top",
                    upper=0.012,
                    lower=0.10,
                    sleeve=1.97,
                    ease=0.019,
                    hang=0.75,
                    tube={0.2: 0.076, 1.0: 0.066, 2.0: 0.047},
                    fabric=Fabric(bending=0.16, thickness=0.008),
                ),
                partial(textures.jacket, (24, 24, 27), (120, 120, 122), 12),
                roughness=0.62,
                specular=0.9,
                thickness=0.004,
                collar=Collar(
                    rows=(
                        (0.012, 0.001),
                        (0.024, 0.003),
                        (0.036, 0.006),
                        (0.041, 0.005),
                        (0.041, 0.001),
                        (0.034, -0.001),
                        (0.01, -0.003),
                        (-0.02, -0.004),
                    ),
                    opening=0.25,
                ),
            ),
        ),
        shoe=ShoeCut(height=0.085, sole=0.016, heel=0.030),
        shoe_texture=partial(textures.leather, (20, 19, 19), (12, 12, 12), 13, laces=True),
        shoe_roughness=0.45,
        sole=(0.008, 0.008, 0.008),
        hair=HairCut(hairline=hairline, thickness=0.015, edge=0.0015, strand=0.22),
        hair_colour=(38, 27, 20),
        face=Face(
            (214, 166, 141), (181, 110, 99), (40, 29, 22), (70, 48, 30), (46, 34, 27), beard=0.45, hairline=hairline
        ),
        seed=1,
    )


def yellow_outfit() -> Outfit:
    """Return the person of `black_outfit`, with the same step and cut of the clothes, in the colours of `yellow_shirt`."""
    look = black_outfit()
    trousers, jacket = look.garments
    return replace(
        look,
        garments=(
            replace(trousers, texture=partial(textures.trousers, (60, 82, 118), 11)),
            replace(jacket, texture=partial(textures.jacket, (246, 196, 16), (250, 240, 205), 12)),
        ),
    )


def yellow_shirt() -> Outfit:
    hairline = {0.0: 42.0, 18.0: 41.0, 35.0: 34.0, 50.0: 20.0, 60.0: -6.0, 75.0: -10.0, 120.0: -14.0, 180.0: -34.0}
    return Outfit(
        shape=BodyShape(sex=0.0, age=0.5, muscle=0.5, weight=0.47, height=0.57, proportions=0.7),
        gait=Gait(phase=0.58, stride=0.80, arm_swing_deg=15.0, elbow_deg=28.0, arm_out_deg=12.0, step_width_m=0.09),
        garments=(
            Garment(
                "jeans",
                Cut(
                    "trousers",
                    upper=0.80,
                    lower=0.075,
                    ease=0.006,
                    tube={0.3: 0.078, 1.0: 0.066, 2.0: 0.062},
                    fabric=Fabric(bending=0.2),
                ),
                partial(textures.jeans, (60, 82, 118), (176, 122, 60), 21),
                roughness=0.9,
                specular=0.6,
            ),
            Garment(
                "shirt",
                Cut(
                    "top",
                    upper=0.0,
                    lower=0.30,
                    sleeve=1.93,
                    ease=0.011,
                    hang=0.55,
                    tube={0.2: 0.056, 1.0: 0.052, 2.0: 0.038},
                    fabric=Fabric(bending=0.05),
                ),
                partial(textures.shirt, (246, 196, 16), (250, 240, 205), 22),
                roughness=0.8,
                specular=0.7,
                thickness=0.002,
                collar=Collar(
                    rows=(
                        (0.01, 0.0),
                        (0.022, 0.0),
                        (0.026, 0.002),
                        (0.022, 0.004),
                        (0.006, 0.006),
                        (-0.018, 0.0065),
                        (-0.018, 0.004),
                        (0.0, 0.002),
                    ),
                    opening=0.2,
                    folded=True,
                ),
            ),
        ),
        shoe=ShoeCut(height=0.070, sole=0.022, heel=0.026),
        shoe_texture=partial(textures.leather, (222, 220, 214), (178, 178, 182), 23, laces=True),
        shoe_roughness=0.6,
        sole=(0.75, 0.74, 0.71),
        hair=HairCut(
            hairline=hairline,
            thickness=0.024,
            edge=0.006,
            fall={0.0: 0.0, 52.0: 0.0, 60.0: 0.085, 90.0: 0.115, 180.0: 0.13},
            strand=0.2,
            parting=20.0,
        ),
        hair_colour=(98, 62, 36),
        face=Face(
            (228, 182, 158),
            (196, 112, 108),
            (84, 56, 36),
            (92, 110, 92),
            (92, 62, 42),
            brow_height=0.0052,
            hairline=None,
        ),
        seed=2,
    )
