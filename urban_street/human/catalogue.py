"""The characters: twelve people who differ in sex, age, build, skin, hair and clothes, one of them in two outfits."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from types import MappingProxyType
from typing import Final

from urban_street.human import fabrics, textures, wardrobe
from urban_street.human.body import BodyShape
from urban_street.human.drape import Fabric
from urban_street.human.hair import HairCut
from urban_street.human.hats import Hat
from urban_street.human.outfits import Outfit, black_outfit, yellow_outfit, yellow_shirt
from urban_street.human.pose import Gait
from urban_street.human.shoes import ShoeCut
from urban_street.human.townspeople import TOWNSPEOPLE


def _red_coat() -> Outfit:
    hair = (186, 182, 178)
    return Outfit(
        shape=BodyShape(sex=0.0, age=0.92, muscle=0.42, weight=0.64, height=0.38, proportions=0.4),
        gait=Gait(
            phase=0.06,
            stride=0.62,
            arm_swing_deg=9.0,
            elbow_deg=30.0,
            arm_out_deg=17.0,
            lean_deg=7.0,
            step_width_m=0.12,
        ),
        garments=(
            wardrobe.tights((44, 38, 40), 31),
            wardrobe.skirt(
                "coat-skirt",
                partial(fabrics.coat_skirt, (150, 26, 34), 33),
                lower=0.36,
                flare=0.05,
                upper=1.0,
                ease=0.018,
            ),
            wardrobe.top(
                "coat",
                partial(fabrics.coat, (150, 26, 34), (60, 22, 22), 32),
                lower=0.42,
                ease=0.022,
                hang=0.8,
                tube={0.2: 0.080, 1.0: 0.070, 2.0: 0.055},
                collar=wardrobe.TURNED_DOWN,
                thickness=0.005,
                roughness=0.9,
                fabric=Fabric(bending=0.2, thickness=0.008),
            ),
        ),
        shoe=ShoeCut(height=0.085, sole=0.020, heel=0.034),
        shoe_texture=partial(textures.leather, (38, 26, 22), (30, 22, 20), 34, laces=False),
        shoe_roughness=0.5,
        sole=(0.01, 0.01, 0.01),
        hair=HairCut(hairline=wardrobe.TIED, thickness=0.020, edge=0.003, strand=0.3, tied="bun"),
        hair_colour=hair,
        face=wardrobe.face("pale", hair, iris=(96, 120, 138), brow_height=0.004),
        seed=3,
        carries="shoulder-bag",
        bag_colour=(62, 40, 28),
    )


def _grey_hoodie() -> Outfit:
    hair = (22, 18, 17)
    return Outfit(
        shape=BodyShape(
            sex=1.0, age=0.46, muscle=0.5, weight=0.38, height=0.58, proportions=0.7, ancestry={"african": 1.0}
        ),
        gait=Gait(phase=0.56, stride=0.94, arm_swing_deg=19.0, elbow_deg=20.0, arm_out_deg=14.0),
        garments=(
            wardrobe.legs(
                "jeans",
                partial(textures.jeans, (38, 46, 66), (150, 110, 70), 41),
                lower=0.07,
                tube={0.25: 0.084, 1.0: 0.068, 2.0: 0.064},
            ),
            wardrobe.top(
                "hoodie",
                partial(fabrics.sweater, (128, 130, 134), 42, pocket=True),
                lower=0.16,
                ease=0.018,
                hang=0.7,
                tube={0.2: 0.074, 1.0: 0.064, 2.0: 0.044},
                collar=wardrobe.HOOD,
                thickness=0.005,
                roughness=0.95,
                fabric=Fabric(bending=0.14, thickness=0.008),
            ),
        ),
        shoe=ShoeCut(height=0.080, sole=0.026, heel=0.030),
        shoe_texture=partial(textures.leather, (200, 44, 38), (240, 240, 238), 43, laces=True),
        shoe_roughness=0.6,
        sole=(0.80, 0.79, 0.77),
        hair=HairCut(hairline=wardrobe.SHORT, thickness=0.020, edge=0.006, strand=0.5),
        hair_colour=hair,
        face=wardrobe.face("dark", hair, brow_height=0.0065, hairline=wardrobe.SHORT),
        seed=4,
        carries="backpack",
        bag_colour=(30, 66, 96),
    )


def _blue_dress() -> Outfit:
    hair = (24, 20, 20)
    blue, white = (36, 70, 138), (232, 232, 228)
    return Outfit(
        shape=BodyShape(
            sex=0.0, age=0.47, muscle=0.42, weight=0.40, height=0.58, proportions=0.8, ancestry={"asian": 1.0}
        ),
        gait=Gait(phase=0.07, stride=0.78, arm_swing_deg=14.0, elbow_deg=24.0, arm_out_deg=14.0, step_width_m=0.08),
        garments=(
            wardrobe.top(
                "dress",
                partial(fabrics.blouse, blue, white, 51, "dots"),
                lower=0.72,
                sleeve=0.55,
                ease=0.009,
                hang=0.15,
                tube={0.2: 0.056, 0.6: 0.062},
                fabric=Fabric(bending=0.06),
                thickness=0.002,
            ),
            wardrobe.skirt(
                "dress-skirt",
                partial(fabrics.skirt, blue, white, 52, "dots"),
                lower=0.50,
                flare=0.13,
                upper=1.0,
                ease=0.012,
            ),
        ),
        shoe=ShoeCut(height=0.058, sole=0.014, heel=0.030),
        shoe_texture=partial(textures.leather, (168, 120, 84), (150, 104, 70), 53, laces=False),
        shoe_roughness=0.45,
        sole=(0.16, 0.10, 0.06),
        hair=HairCut(hairline=wardrobe.FRINGE, thickness=0.020, edge=0.004, strand=0.2, tied="ponytail"),
        hair_colour=hair,
        face=wardrobe.face("tan", hair, brow_height=0.0048),
        seed=5,
    )


def _white_tee() -> Outfit:
    hair = (84, 58, 38)
    return Outfit(
        shape=BodyShape(
            sex=1.0,
            age=0.62,
            muscle=0.48,
            weight=0.92,
            height=0.55,
            proportions=0.3,
            details={"stomach/stomach-tone-decr": 0.7},
        ),
        gait=Gait(
            phase=0.06,
            stride=0.78,
            arm_swing_deg=14.0,
            elbow_deg=26.0,
            arm_out_deg=24.0,
            step_width_m=0.17,
            lean_deg=0.5,
        ),
        garments=(
            wardrobe.legs(
                "shorts",
                partial(textures.trousers, (142, 126, 94), 61),
                lower=0.50,
                upper=0.62,
                tube={0.25: 0.110, 1.0: 0.112, 1.3: 0.112},
            ),
            wardrobe.top(
                "tee",
                partial(fabrics.tee, (228, 228, 224), (190, 40, 40), 62),
                lower=0.06,
                sleeve=0.72,
                ease=0.014,
                hang=0.85,
                tube={0.2: 0.082, 0.8: 0.088},
                fabric=Fabric(bending=0.06),
                thickness=0.002,
            ),
        ),
        shoe=ShoeCut(height=0.076, sole=0.026, heel=0.030),
        shoe_texture=partial(textures.leather, (58, 60, 66), (150, 200, 60), 63, laces=True),
        shoe_roughness=0.7,
        sole=(0.55, 0.55, 0.55),
        hair=HairCut(hairline=wardrobe.SHORT, thickness=0.010, edge=0.0015, strand=0.25),
        hair_colour=hair,
        face=wardrobe.face("fair", hair, iris=(86, 110, 124), beard=0.7, hairline=wardrobe.SHORT),
        hat=Hat("cap", partial(fabrics.felt, (30, 46, 92), (30, 46, 92), 64)),
        seed=6,
    )


def _striped_boy() -> Outfit:
    hair = (128, 92, 54)
    k = 0.78
    return Outfit(
        shape=BodyShape(sex=1.0, age=0.165, muscle=0.5, weight=0.46, height=0.5, proportions=0.5),
        gait=Gait(phase=0.06, stride=0.95, arm_swing_deg=22.0, elbow_deg=28.0, arm_out_deg=15.0, step_width_m=0.09),
        garments=(
            wardrobe.legs(
                "shorts",
                partial(textures.trousers, (52, 64, 92), 71),
                lower=0.33,
                k=k,
                tube={0.25: 0.096, 1.0: 0.096, 1.2: 0.096},
            ),
            wardrobe.top(
                "tee",
                partial(fabrics.tee, (236, 234, 226), (196, 48, 42), 72, "stripes"),
                lower=0.06,
                k=k,
                sleeve=0.75,
                tube={0.2: 0.064, 0.8: 0.070},
                fabric=Fabric(bending=0.06),
                thickness=0.002,
            ),
        ),
        shoe=ShoeCut(height=0.066, sole=0.020, heel=0.024),
        shoe_texture=partial(textures.leather, (40, 92, 170), (236, 236, 232), 73, laces=True),
        shoe_roughness=0.6,
        sole=(0.78, 0.78, 0.76),
        hair=HairCut(hairline=wardrobe.FRINGE, thickness=0.018, edge=0.005, strand=0.3),
        hair_colour=hair,
        face=wardrobe.face("fair", hair, iris=(92, 108, 84), brow_height=0.004),
        seed=7,
    )


def _pink_girl() -> Outfit:
    hair = (52, 34, 24)
    k = 0.74
    return Outfit(
        shape=BodyShape(
            sex=0.0,
            age=0.15,
            muscle=0.5,
            weight=0.5,
            height=0.5,
            proportions=0.5,
            ancestry={"african": 0.4, "caucasian": 0.6},
        ),
        gait=Gait(phase=0.57, stride=0.9, arm_swing_deg=20.0, elbow_deg=26.0, arm_out_deg=17.0, step_width_m=0.08),
        garments=(
            wardrobe.tights((58, 54, 92), 81, 0.05),
            wardrobe.skirt(
                "skirt",
                partial(fabrics.skirt, (84, 62, 128), (240, 240, 240), 82, "pleats"),
                lower=0.36,
                flare=0.09,
                upper=0.7,
                ease=0.010,
            ),
            wardrobe.top(
                "jacket",
                partial(textures.jacket, (206, 92, 132), (230, 230, 230), 83),
                lower=0.22,
                k=k,
                ease=0.018,
                hang=0.7,
                tube={0.2: 0.076, 1.0: 0.068, 2.0: 0.048},
                collar=wardrobe.STAND_UP,
                thickness=0.004,
                roughness=0.6,
                fabric=Fabric(bending=0.16, thickness=0.007),
            ),
        ),
        shoe=ShoeCut(height=0.070, sole=0.018, heel=0.020),
        shoe_texture=partial(textures.leather, (226, 222, 214), (206, 92, 132), 84, laces=True),
        shoe_roughness=0.5,
        sole=(0.80, 0.78, 0.76),
        hair=HairCut(hairline=wardrobe.TIED, thickness=0.018, edge=0.003, strand=0.3, tied="ponytail"),
        hair_colour=hair,
        face=wardrobe.face("olive", hair, brow_height=0.004),
        seed=8,
        carries="backpack",
        bag_colour=(226, 172, 40),
    )


def _brown_hat() -> Outfit:
    hair = (206, 204, 200)
    return Outfit(
        shape=BodyShape(sex=1.0, age=0.97, muscle=0.36, weight=0.5, height=0.46, proportions=0.4),
        gait=Gait(
            phase=0.57, stride=0.6, arm_swing_deg=9.0, elbow_deg=30.0, arm_out_deg=15.0, lean_deg=9.0, step_width_m=0.13
        ),
        garments=(
            wardrobe.legs(
                "trousers",
                partial(textures.trousers, (86, 70, 56), 91),
                lower=0.055,
                upper=0.86,
                tube={0.25: 0.098, 1.0: 0.090, 2.0: 0.084},
            ),
            wardrobe.top(
                "jacket",
                partial(textures.jacket, (168, 148, 112), (130, 120, 90), 92),
                lower=0.02,
                ease=0.022,
                hang=0.85,
                tube={0.2: 0.080, 1.0: 0.070, 2.0: 0.052},
                collar=wardrobe.TURNED_DOWN,
                thickness=0.004,
                fabric=Fabric(bending=0.16, thickness=0.008),
            ),
        ),
        shoe=ShoeCut(height=0.080, sole=0.016, heel=0.028),
        shoe_texture=partial(textures.leather, (72, 44, 26), (50, 32, 20), 93, laces=True),
        shoe_roughness=0.4,
        sole=(0.03, 0.02, 0.015),
        hair=HairCut(hairline=wardrobe.RECEDED, thickness=0.008, edge=0.0015, strand=0.3),
        hair_colour=hair,
        face=wardrobe.face("fair", hair, iris=(104, 122, 132), beard=0.5, hairline=wardrobe.RECEDED),
        hat=Hat("brimmed", partial(fabrics.felt, (98, 78, 56), (40, 30, 24), 94)),
        seed=9,
    )


def _green_parka() -> Outfit:
    hair = (28, 22, 20)
    return Outfit(
        shape=BodyShape(
            sex=0.0,
            age=0.56,
            muscle=0.5,
            weight=0.80,
            height=0.52,
            proportions=0.4,
            ancestry={"african": 0.8, "caucasian": 0.2},
        ),
        gait=Gait(phase=0.06, stride=0.74, arm_swing_deg=13.0, elbow_deg=24.0, arm_out_deg=19.0, step_width_m=0.12),
        garments=(
            wardrobe.legs(
                "trousers",
                partial(textures.trousers, (36, 34, 38), 101),
                lower=0.06,
                tube={0.25: 0.100, 1.0: 0.080, 2.0: 0.070},
            ),
            wardrobe.top(
                "parka",
                partial(textures.jacket, (66, 82, 52), (150, 140, 96), 102),
                lower=-0.25,
                ease=0.026,
                hang=0.85,
                tube={0.2: 0.092, 1.0: 0.082, 2.0: 0.058},
                collar=wardrobe.HOOD,
                thickness=0.006,
                roughness=0.7,
                fabric=Fabric(bending=0.2, thickness=0.010),
            ),
        ),
        shoe=ShoeCut(height=0.10, sole=0.024, heel=0.032),
        shoe_texture=partial(textures.leather, (124, 84, 48), (90, 60, 34), 103, laces=True),
        shoe_roughness=0.6,
        sole=(0.05, 0.04, 0.03),
        hair=HairCut(
            hairline=wardrobe.LONG,
            thickness=0.014,
            edge=0.006,
            fall={0.0: 0.0, 52.0: 0.0, 60.0: 0.06, 90.0: 0.09, 180.0: 0.10},
            strand=0.4,
        ),
        hair_colour=hair,
        face=wardrobe.face("brown", hair, brow_height=0.0055),
        hat=Hat("beanie", partial(fabrics.knit, (176, 62, 40), (150, 48, 32), 104)),
        seed=10,
        carries="shopping-bag",
    )


def _navy_coat() -> Outfit:
    hair = (104, 98, 94)
    navy = (26, 32, 54)
    return Outfit(
        shape=BodyShape(sex=1.0, age=0.68, muscle=0.52, weight=0.60, height=0.62, proportions=0.5),
        gait=Gait(phase=0.56, stride=0.86, arm_swing_deg=14.0, elbow_deg=22.0, arm_out_deg=15.0),
        garments=(
            wardrobe.legs(
                "trousers",
                partial(textures.trousers, (58, 60, 66), 111),
                lower=0.055,
                tube={0.25: 0.094, 1.0: 0.086, 2.0: 0.080},
            ),
            wardrobe.skirt(
                "coat-skirt", partial(fabrics.coat_skirt, navy, 113), lower=0.52, flare=0.05, upper=1.0, ease=0.022
            ),
            wardrobe.top(
                "coat",
                partial(fabrics.coat, navy, (14, 14, 18), 112, belt=True),
                lower=0.45,
                ease=0.024,
                hang=0.8,
                tube={0.2: 0.084, 1.0: 0.074, 2.0: 0.055},
                collar=wardrobe.TURNED_DOWN,
                thickness=0.005,
                roughness=0.9,
                fabric=Fabric(bending=0.2, thickness=0.008),
            ),
        ),
        shoe=ShoeCut(height=0.078, sole=0.014, heel=0.030),
        shoe_texture=partial(textures.leather, (18, 16, 16), (12, 12, 12), 114, laces=True),
        shoe_roughness=0.25,
        sole=(0.01, 0.01, 0.01),
        hair=HairCut(hairline=wardrobe.RECEDED, thickness=0.012, edge=0.0015, strand=0.25),
        hair_colour=hair,
        face=wardrobe.face("fair", hair, beard=0.3, hairline=wardrobe.RECEDED),
        seed=11,
        carries="umbrella",
        umbrella_colour=(24, 26, 34),
    )


def _orange_workwear() -> Outfit:
    hair = (30, 24, 20)
    return Outfit(
        shape=BodyShape(sex=1.0, age=0.52, muscle=0.72, weight=0.60, height=0.50, proportions=0.5),
        gait=Gait(phase=0.06, stride=0.9, arm_swing_deg=18.0, elbow_deg=24.0, arm_out_deg=17.0, step_width_m=0.13),
        garments=(
            wardrobe.legs(
                "trousers",
                partial(fabrics.tee, (214, 92, 26), (206, 206, 200), 121, "block"),
                lower=0.06,
                tube={0.25: 0.104, 1.0: 0.098, 2.0: 0.092},
            ),
            wardrobe.top(
                "jacket",
                partial(fabrics.tee, (222, 98, 24), (206, 206, 200), 122, "block"),
                lower=0.05,
                ease=0.020,
                hang=0.8,
                tube={0.2: 0.082, 1.0: 0.072, 2.0: 0.052},
                collar=wardrobe.STAND_UP,
                thickness=0.004,
                roughness=0.75,
                fabric=Fabric(bending=0.16, thickness=0.008),
            ),
        ),
        shoe=ShoeCut(height=0.11, sole=0.028, heel=0.034),
        shoe_texture=partial(textures.leather, (50, 40, 32), (30, 26, 22), 123, laces=True),
        shoe_roughness=0.7,
        sole=(0.03, 0.03, 0.03),
        hair=HairCut(hairline=wardrobe.SHORT, thickness=0.012, edge=0.0015, strand=0.22),
        hair_colour=hair,
        face=wardrobe.face("olive", hair, beard=0.9, hairline=wardrobe.SHORT),
        seed=12,
    )


#: Builders of the looks, by the names in specs.
LOOKS: Final[Mapping[str, Callable[[], Outfit]]] = MappingProxyType(
    {
        "black-outfit": black_outfit,
        "yellow-shirt": yellow_shirt,
        "red-coat": _red_coat,
        "grey-hoodie": _grey_hoodie,
        "blue-dress": _blue_dress,
        "white-tee": _white_tee,
        "striped-boy": _striped_boy,
        "pink-girl": _pink_girl,
        "brown-hat": _brown_hat,
        "green-parka": _green_parka,
        "navy-coat": _navy_coat,
        "orange-workwear": _orange_workwear,
        "yellow-outfit": yellow_outfit,
        **TOWNSPEOPLE,
    }
)

#: Names of the characters.
CHARACTERS: Final = tuple(LOOKS)
