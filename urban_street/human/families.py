"""Characters of other ages: a toddler, teenagers, an expectant mother, the very old."""

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
from urban_street.human.outfits import Outfit
from urban_street.human.pose import Gait
from urban_street.human.shoes import ShoeCut

_LIGHT: Final = Fabric(bending=0.06)


def _yellow_toddler() -> Outfit:
    hair = (150, 112, 66)
    k = 0.58
    return Outfit(
        shape=BodyShape(sex=0.4, age=0.085, muscle=0.5, weight=0.55, height=0.5, proportions=0.5),
        gait=Gait(phase=0.06, stride=0.80, arm_swing_deg=12.0, elbow_deg=34.0, arm_out_deg=26.0, step_width_m=0.10),
        garments=(
            wardrobe.legs(
                "trousers", partial(textures.trousers, (52, 70, 118), 271),
                lower=0.05, k=k, tube={0.25: 0.104, 1.0: 0.098, 2.0: 0.090},
            ),
            wardrobe.top(
                "raincoat", partial(textures.jacket, (238, 190, 30), (250, 240, 200), 272),
                lower=-0.10, k=k, ease=0.014, hang=0.8, tube={0.2: 0.092, 1.0: 0.084, 2.0: 0.066},
                collar=wardrobe.STAND_UP, roughness=0.4, fabric=Fabric(bending=0.22, thickness=0.006),
            ),
        ),
        shoe=ShoeCut(height=0.085, sole=0.014, heel=0.016),
        shoe_texture=partial(textures.leather, (196, 44, 48), (196, 44, 48), 273, laces=False),
        shoe_roughness=0.3,
        sole=(0.30, 0.05, 0.05),
        hair=HairCut(hairline=wardrobe.FRINGE, thickness=0.016, edge=0.005, strand=0.3),
        hair_colour=hair,
        face=wardrobe.face("pale", hair, iris=(92, 120, 140), brow_height=0.0035),
        hat=Hat("beanie", partial(fabrics.knit, (60, 120, 170), (236, 236, 230), 274)),
        seed=21,
    )  # fmt: skip


def _checked_skirt() -> Outfit:
    hair = (28, 22, 22)
    return Outfit(
        shape=BodyShape(
            sex=0.0, age=0.32, muscle=0.46, weight=0.44, height=0.60, proportions=0.6, ancestry={"asian": 1.0},
        ),
        gait=Gait(phase=0.07, stride=0.84, arm_swing_deg=15.0, elbow_deg=24.0, arm_out_deg=14.0, step_width_m=0.08),
        garments=(
            wardrobe.tights((30, 32, 46), 281, 0.05),
            wardrobe.skirt(
                "skirt", partial(fabrics.skirt, (96, 34, 40), (200, 196, 180), 282, "checks"),
                lower=0.44, flare=0.09, upper=0.85, ease=0.010,
            ),
            wardrobe.top(
                "sweater", partial(fabrics.sweater, (28, 40, 78), 283),
                lower=0.34, ease=0.012, hang=0.5, tube={0.2: 0.058, 1.0: 0.052, 2.0: 0.038},
            ),
        ),
        shoe=ShoeCut(height=0.064, sole=0.018, heel=0.024),
        shoe_texture=partial(textures.leather, (24, 20, 20), (18, 16, 16), 284, laces=False),
        shoe_roughness=0.35,
        sole=(0.02, 0.02, 0.02),
        hair=HairCut(
            hairline=wardrobe.LONG, thickness=0.020, edge=0.005,
            fall={0.0: 0.0, 52.0: 0.0, 60.0: 0.13, 90.0: 0.17, 180.0: 0.20}, strand=0.15, parting=0.0,
        ),
        hair_colour=hair,
        face=wardrobe.face("tan", hair, brow_height=0.0042),
        seed=22,
        carries="backpack",
        bag_colour=(58, 62, 70),
    )  # fmt: skip


def _black_hood() -> Outfit:
    hair = (74, 52, 36)
    return Outfit(
        shape=BodyShape(sex=1.0, age=0.34, muscle=0.42, weight=0.34, height=0.50, proportions=0.5),
        gait=Gait(phase=0.56, stride=0.90, arm_swing_deg=14.0, elbow_deg=30.0, arm_out_deg=14.0, lean_deg=5.0),
        garments=(
            wardrobe.legs(
                "jeans", partial(textures.jeans, (92, 104, 124), (170, 140, 96), 291),
                lower=0.06, tube={0.25: 0.090, 1.0: 0.078, 2.0: 0.076},
            ),
            wardrobe.top(
                "hoodie", partial(fabrics.sweater, (40, 40, 44), 292, pocket=True),
                lower=0.16, ease=0.020, hang=0.8, tube={0.2: 0.074, 1.0: 0.066, 2.0: 0.046},
                thickness=0.005, roughness=0.95, fabric=Fabric(bending=0.14, thickness=0.008),
            ),
        ),
        shoe=ShoeCut(height=0.090, sole=0.026, heel=0.028),
        shoe_texture=partial(textures.leather, (236, 236, 232), (40, 40, 44), 293, laces=True),
        shoe_roughness=0.6,
        sole=(0.82, 0.82, 0.80),
        hair=HairCut(hairline=wardrobe.FRINGE, thickness=0.014, edge=0.004, strand=0.4),
        hair_colour=hair,
        face=wardrobe.face("pale", hair, iris=(88, 108, 120), brow_height=0.0055),
        hat=Hat("hood", partial(fabrics.scarf, (40, 40, 44), 294)),
        seed=23,
    )  # fmt: skip


def _mint_mother() -> Outfit:
    hair = (150, 74, 40)
    mint = (150, 204, 180)
    return Outfit(
        shape=BodyShape(
            sex=0.0, age=0.53, muscle=0.44, weight=0.55, height=0.55, proportions=0.6,
            details={"stomach/stomach-pregnant-incr": 0.85},
        ),
        gait=Gait(
            phase=0.06, stride=0.66, arm_swing_deg=12.0, elbow_deg=24.0, arm_out_deg=19.0, step_width_m=0.14,
            lean_deg=-3.0,
        ),
        garments=(
            wardrobe.tights((46, 48, 58), 301, 0.10),
            wardrobe.skirt(
                "dress-skirt", partial(fabrics.skirt, mint, (240, 240, 236), 302, "dots"),
                lower=0.46, flare=0.06, upper=1.0, ease=0.014,
            ),
            wardrobe.top(
                "dress", partial(fabrics.blouse, mint, (240, 240, 236), 303, "dots"),
                lower=0.42, sleeve=1.45, ease=0.010, hang=0.35, tube={0.2: 0.062, 1.0: 0.056}, fabric=_LIGHT,
                thickness=0.002,
            ),
        ),
        shoe=ShoeCut(height=0.060, sole=0.018, heel=0.024),
        shoe_texture=partial(textures.leather, (190, 150, 120), (160, 124, 96), 304, laces=False),
        shoe_roughness=0.5,
        sole=(0.30, 0.22, 0.16),
        hair=HairCut(
            hairline=wardrobe.LONG, thickness=0.024, edge=0.006,
            fall={0.0: 0.0, 52.0: 0.0, 60.0: 0.07, 90.0: 0.10, 180.0: 0.11}, strand=0.3, parting=-20.0,
        ),
        hair_colour=hair,
        face=wardrobe.face("pale", hair, iris=(86, 116, 96), brow_height=0.0045),
        seed=24,
    )  # fmt: skip


def _plum_cardigan() -> Outfit:
    hair = (214, 212, 210)
    return Outfit(
        shape=BodyShape(
            sex=0.0, age=0.97, muscle=0.38, weight=0.48, height=0.26, proportions=0.4, ancestry={"african": 0.9, "asian": 0.1},
        ),
        gait=Gait(
            phase=0.06, stride=0.55, arm_swing_deg=8.0, elbow_deg=32.0, arm_out_deg=16.0, lean_deg=9.0, step_width_m=0.12,
        ),
        garments=(
            wardrobe.tights((70, 52, 44), 311),
            wardrobe.skirt(
                "skirt", partial(fabrics.skirt, (70, 66, 78), (110, 104, 118), 312),
                lower=0.26, flare=0.06, upper=0.9, ease=0.012,
            ),
            wardrobe.top(
                "cardigan", partial(fabrics.cardigan, (112, 54, 92), (226, 214, 196), 313),
                lower=0.22, ease=0.016, hang=0.7, tube={0.2: 0.068, 1.0: 0.060, 2.0: 0.046}, thickness=0.004,
            ),
        ),
        shoe=ShoeCut(height=0.058, sole=0.016, heel=0.028),
        shoe_texture=partial(textures.leather, (58, 40, 34), (44, 32, 28), 314, laces=False),
        shoe_roughness=0.5,
        sole=(0.02, 0.02, 0.02),
        hair=HairCut(hairline=wardrobe.SHORT, thickness=0.030, edge=0.008, strand=0.55),
        hair_colour=hair,
        face=wardrobe.face("brown", hair, brow_height=0.0035),
        seed=25,
        carries="shoulder-bag",
        bag_colour=(44, 36, 40),
    )  # fmt: skip


def _tweed_cap() -> Outfit:
    hair = (196, 194, 190)
    return Outfit(
        shape=BodyShape(
            sex=1.0, age=0.94, muscle=0.42, weight=0.42, height=0.34, proportions=0.4, ancestry={"asian": 1.0},
        ),
        gait=Gait(
            phase=0.57, stride=0.62, arm_swing_deg=9.0, elbow_deg=28.0, arm_out_deg=15.0, lean_deg=8.0, step_width_m=0.12,
        ),
        garments=(
            wardrobe.legs(
                "trousers", partial(textures.trousers, (70, 72, 66), 321),
                lower=0.05, upper=0.86, tube={0.25: 0.094, 1.0: 0.086, 2.0: 0.080},
            ),
            wardrobe.top(
                "vest", partial(fabrics.cardigan, (120, 112, 84), (206, 212, 222), 322),
                lower=0.14, ease=0.016, hang=0.7, tube={0.2: 0.070, 1.0: 0.062, 2.0: 0.046},
                collar=wardrobe.TURNED_DOWN, thickness=0.003,
            ),
        ),
        shoe=ShoeCut(height=0.070, sole=0.016, heel=0.026),
        shoe_texture=partial(textures.leather, (60, 44, 34), (44, 32, 24), 323, laces=True),
        shoe_roughness=0.5,
        sole=(0.03, 0.02, 0.02),
        hair=HairCut(hairline=wardrobe.RECEDED, thickness=0.008, edge=0.0015, strand=0.3),
        hair_colour=hair,
        face=wardrobe.face("tan", hair, beard=0.3, hairline=wardrobe.RECEDED),
        hat=Hat("cap", partial(fabrics.felt, (122, 112, 92), (122, 112, 92), 324)),
        seed=26,
    )  # fmt: skip


#: Builders of the looks, by the names in specs.
FAMILIES: Final[Mapping[str, Callable[[], Outfit]]] = MappingProxyType(
    {
        "yellow-toddler": _yellow_toddler,
        "checked-skirt": _checked_skirt,
        "black-hood": _black_hood,
        "mint-mother": _mint_mother,
        "plum-cardigan": _plum_cardigan,
        "tweed-cap": _tweed_cap,
    }
)
