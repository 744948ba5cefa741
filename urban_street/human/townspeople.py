"""More characters: grown people in the clothes of many trades, sports and faiths; and the `families`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from types import MappingProxyType
from typing import Final

from urban_street.human import fabrics, textures, wardrobe
from urban_street.human.body import BodyShape
from urban_street.human.drape import Fabric
from urban_street.human.families import FAMILIES
from urban_street.human.hair import HairCut
from urban_street.human.hats import Hat
from urban_street.human.outfits import Outfit
from urban_street.human.pose import Gait
from urban_street.human.shoes import ShoeCut

_COARSE: Final = Fabric(bending=0.2, thickness=0.008)
_LIGHT: Final = Fabric(bending=0.06)


def _teal_headscarf() -> Outfit:
    teal, hair = (40, 112, 116), (30, 24, 20)
    return Outfit(
        shape=BodyShape(
            sex=0.0, age=0.53, muscle=0.45, weight=0.52, height=0.45, proportions=0.7,
            details={"nose/nose-hump-incr": 0.4, "cheek/l-cheek-volume-incr": 0.3, "cheek/r-cheek-volume-incr": 0.3},
        ),
        gait=Gait(phase=0.06, stride=0.74, arm_swing_deg=12.0, elbow_deg=24.0, arm_out_deg=15.0, step_width_m=0.09),
        garments=(
            wardrobe.skirt(
                "coat-skirt", partial(fabrics.coat_skirt, (196, 184, 164), 203),
                lower=0.10, flare=0.10, upper=1.0, ease=0.018,
            ),
            wardrobe.top(
                "coat", partial(fabrics.coat, (196, 184, 164), (120, 104, 84), 202, belt=True),
                lower=0.45, ease=0.020, hang=0.8, tube={0.2: 0.074, 1.0: 0.066, 2.0: 0.052},
                roughness=0.9, thickness=0.004, fabric=_COARSE,
            ),
        ),
        shoe=ShoeCut(height=0.062, sole=0.018, heel=0.030),
        shoe_texture=partial(textures.leather, (60, 44, 36), (48, 34, 28), 204, laces=False),
        shoe_roughness=0.5,
        sole=(0.03, 0.02, 0.02),
        hair=None,
        hair_colour=hair,
        face=wardrobe.face("olive", hair, brow_height=0.0052),
        hat=Hat("headscarf", partial(fabrics.scarf, teal, 205)),
        seed=14,
        carries="shoulder-bag",
        bag_colour=(96, 60, 42),
    )  # fmt: skip


def _saffron_turban() -> Outfit:
    hair = (26, 22, 20)
    return Outfit(
        shape=BodyShape(
            sex=1.0, age=0.60, muscle=0.55, weight=0.62, height=0.60, proportions=0.6,
            ancestry={"asian": 0.35, "caucasian": 0.65}, details={"nose/nose-hump-incr": 0.5},
        ),
        gait=Gait(phase=0.56, stride=0.84, arm_swing_deg=15.0, elbow_deg=22.0, arm_out_deg=16.0),
        garments=(
            wardrobe.legs(
                "trousers", partial(textures.trousers, (186, 178, 160), 211),
                lower=0.05, tube={0.25: 0.104, 1.0: 0.090, 2.0: 0.078},
            ),
            wardrobe.top(
                "shirt", partial(textures.shirt, (150, 176, 206), (236, 236, 232), 212),
                lower=-0.12, ease=0.016, hang=0.8, tube={0.2: 0.074, 1.0: 0.066, 2.0: 0.046}, fabric=_LIGHT,
                collar=wardrobe.TURNED_DOWN, thickness=0.002,
            ),
        ),
        shoe=ShoeCut(height=0.070, sole=0.016, heel=0.026),
        shoe_texture=partial(textures.leather, (112, 74, 44), (90, 60, 36), 213, laces=False),
        shoe_roughness=0.45,
        sole=(0.03, 0.02, 0.015),
        hair=None,
        hair_colour=hair,
        face=wardrobe.face("brown", hair, beard=1.9),
        hat=Hat("turban", partial(fabrics.scarf, (222, 132, 36), 214)),
        seed=15,
    )  # fmt: skip


def _violet_sari() -> Outfit:
    hair = (40, 34, 32)
    violet, gold = (108, 42, 112), (206, 160, 70)
    return Outfit(
        shape=BodyShape(
            sex=0.0, age=0.66, muscle=0.42, weight=0.74, height=0.40, proportions=0.5,
            ancestry={"asian": 0.3, "caucasian": 0.7},
        ),
        gait=Gait(phase=0.06, stride=0.60, arm_swing_deg=10.0, elbow_deg=26.0, arm_out_deg=17.0, step_width_m=0.10),
        garments=(
            wardrobe.skirt(
                "sari-skirt", partial(fabrics.skirt, violet, gold, 222, "border"),
                lower=0.05, flare=0.09, upper=1.0, ease=0.012,
            ),
            wardrobe.top(
                "sari", partial(fabrics.sari, (200, 120, 60), violet, gold, 221),
                lower=0.50, sleeve=0.62, ease=0.010, hang=0.5, tube={0.2: 0.066, 0.7: 0.066}, fabric=_LIGHT,
                thickness=0.002,
            ),
        ),
        shoe=ShoeCut(height=0.050, sole=0.016, heel=0.024),
        shoe_texture=partial(textures.leather, (150, 106, 60), (180, 140, 80), 223, laces=False),
        shoe_roughness=0.4,
        sole=(0.10, 0.06, 0.03),
        hair=HairCut(hairline=wardrobe.TIED, thickness=0.018, edge=0.002, strand=0.25, parting=0.0, tied="bun"),
        hair_colour=hair,
        face=wardrobe.face("brown", hair, brow_height=0.005),
        seed=16,
    )  # fmt: skip


def _grey_suit() -> Outfit:
    hair = (58, 48, 42)
    return Outfit(
        shape=BodyShape(
            sex=1.0, age=0.63, muscle=0.50, weight=0.46, height=0.60, proportions=0.7,
            details={"chin/chin-prominent-incr": 0.4, "head/head-oval": 0.5},
        ),
        gait=Gait(phase=0.06, stride=0.90, arm_swing_deg=16.0, elbow_deg=20.0, arm_out_deg=13.0),
        garments=(
            wardrobe.legs(
                "trousers", partial(textures.trousers, (74, 78, 88), 231),
                lower=0.05, tube={0.25: 0.096, 1.0: 0.084, 2.0: 0.076},
            ),
            wardrobe.top(
                "jacket", partial(fabrics.suit, (74, 78, 88), (236, 236, 234), (122, 30, 40), 232),
                lower=-0.10, ease=0.020, hang=0.6, tube={0.2: 0.074, 1.0: 0.064, 2.0: 0.050},
                collar=wardrobe.TURNED_DOWN, thickness=0.004, fabric=Fabric(bending=0.22, thickness=0.008),
            ),
        ),
        shoe=ShoeCut(height=0.066, sole=0.012, heel=0.026),
        shoe_texture=partial(textures.leather, (30, 20, 16), (20, 14, 12), 233, laces=True),
        shoe_roughness=0.25,
        sole=(0.01, 0.01, 0.01),
        hair=HairCut(hairline=wardrobe.SHORT, thickness=0.018, edge=0.0015, strand=0.2, parting=-28.0),
        hair_colour=hair,
        face=wardrobe.face("fair", hair, iris=(84, 104, 120), beard=0.25, hairline=wardrobe.SHORT),
        seed=17,
    )  # fmt: skip


def _lime_vest() -> Outfit:
    hair = (122, 82, 46)
    return Outfit(
        shape=BodyShape(sex=0.0, age=0.56, muscle=0.60, weight=0.56, height=0.56, proportions=0.5),
        gait=Gait(phase=0.56, stride=0.86, arm_swing_deg=16.0, elbow_deg=24.0, arm_out_deg=18.0, step_width_m=0.12),
        garments=(
            wardrobe.legs(
                "trousers", partial(textures.trousers, (44, 52, 72), 241),
                lower=0.06, tube={0.25: 0.098, 1.0: 0.090, 2.0: 0.084},
            ),
            wardrobe.top(
                "sweater", partial(fabrics.sweater, (60, 66, 78), 242),
                lower=0.10, ease=0.014, hang=0.6, tube={0.2: 0.068, 1.0: 0.060, 2.0: 0.044},
            ),
            wardrobe.top(
                "vest", partial(fabrics.vest, (206, 226, 40), (198, 200, 202), 243),
                upper=-0.015, lower=0.04, sleeve=0.02, ease=0.020, hang=0.9, tube={}, collar=None,
                thickness=0.002, roughness=0.6, fabric=Fabric(bending=0.16, thickness=0.007),
            ),
        ),
        shoe=ShoeCut(height=0.115, sole=0.028, heel=0.034),
        shoe_texture=partial(textures.leather, (150, 112, 62), (60, 44, 30), 244, laces=True),
        shoe_roughness=0.7,
        sole=(0.03, 0.03, 0.03),
        hair=HairCut(hairline=wardrobe.TIED, thickness=0.016, edge=0.003, strand=0.3, tied="ponytail"),
        hair_colour=hair,
        face=wardrobe.face("fair", hair, iris=(96, 116, 92), brow_height=0.0052),
        hat=Hat("cap", partial(fabrics.felt, (40, 46, 62), (206, 226, 40), 245)),
        seed=18,
    )  # fmt: skip


def _coral_runner() -> Outfit:
    hair = (22, 18, 16)
    return Outfit(
        shape=BodyShape(
            sex=0.0, age=0.47, muscle=0.72, weight=0.34, height=0.62, proportions=0.8, ancestry={"african": 1.0},
        ),
        gait=Gait(phase=0.06, stride=0.96, arm_swing_deg=20.0, elbow_deg=30.0, arm_out_deg=13.0, step_width_m=0.08),
        garments=(
            wardrobe.legs(
                "leggings", partial(fabrics.sports, (30, 32, 44), (236, 96, 80), 251),
                lower=0.14, upper=0.9, ease=0.003, tube={}, fabric=Fabric(bending=0.3),
            ),
            wardrobe.top(
                "tank", partial(fabrics.tee, (238, 104, 84), (250, 240, 236), 252),
                upper=-0.035, lower=0.30, sleeve=0.10, ease=0.006, hang=0.25, tube={}, collar=None,
                fabric=_LIGHT, thickness=0.002,
            ),
        ),
        shoe=ShoeCut(height=0.068, sole=0.028, heel=0.034),
        shoe_texture=partial(textures.leather, (90, 214, 196), (250, 250, 250), 253, laces=True),
        shoe_roughness=0.6,
        sole=(0.85, 0.85, 0.83),
        hair=HairCut(hairline=wardrobe.TIED, thickness=0.012, edge=0.003, strand=0.5, tied="bun"),
        hair_colour=hair,
        face=wardrobe.face("dark", hair, brow_height=0.005),
        seed=19,
    )  # fmt: skip


def _azure_jersey() -> Outfit:
    hair = (24, 22, 22)
    return Outfit(
        shape=BodyShape(
            sex=1.0, age=0.48, muscle=0.66, weight=0.42, height=0.46, proportions=0.7, ancestry={"asian": 1.0},
        ),
        gait=Gait(phase=0.56, stride=0.94, arm_swing_deg=19.0, elbow_deg=26.0, arm_out_deg=15.0),
        garments=(
            wardrobe.legs(
                "shorts", partial(fabrics.sports, (24, 26, 34), (240, 240, 240), 261),
                lower=0.56, tube={0.25: 0.100, 1.0: 0.112, 1.2: 0.112}, fabric=_LIGHT,
            ),
            wardrobe.top(
                "jersey", partial(fabrics.tee, (34, 124, 206), (240, 240, 240), 262, "block"),
                lower=0.08, sleeve=0.62, ease=0.012, hang=0.6, tube={0.2: 0.070, 0.7: 0.078}, fabric=_LIGHT,
                thickness=0.002,
            ),
        ),
        shoe=ShoeCut(height=0.070, sole=0.028, heel=0.034),
        shoe_texture=partial(textures.leather, (240, 240, 60), (30, 30, 34), 263, laces=True),
        shoe_roughness=0.6,
        sole=(0.80, 0.80, 0.78),
        hair=HairCut(hairline=wardrobe.SHORT, thickness=0.022, edge=0.0015, strand=0.45),
        hair_colour=hair,
        face=wardrobe.face("tan", hair, hairline=wardrobe.SHORT),
        seed=20,
    )  # fmt: skip


def _denim_jacket() -> Outfit:
    hair = (62, 40, 26)
    return Outfit(
        shape=BodyShape(
            sex=1.0, age=0.46, muscle=0.46, weight=1.0, height=0.62, proportions=0.3,
            ancestry={"caucasian": 0.7, "african": 0.3}, details={"stomach/stomach-tone-decr": 0.9},
        ),
        gait=Gait(
            phase=0.06, stride=0.76, arm_swing_deg=14.0, elbow_deg=26.0, arm_out_deg=27.0, step_width_m=0.18, lean_deg=0.0,
        ),
        garments=(
            wardrobe.legs(
                "trousers", partial(textures.trousers, (52, 50, 48), 331),
                lower=0.05, upper=0.62, tube={0.25: 0.118, 1.0: 0.100, 2.0: 0.088},
            ),
            wardrobe.top(
                "jacket", partial(fabrics.denim_jacket, (72, 96, 132), (186, 140, 84), 332),
                lower=0.14, ease=0.018, hang=0.85, tube={0.2: 0.092, 1.0: 0.078, 2.0: 0.054},
                collar=wardrobe.TURNED_DOWN, thickness=0.004, fabric=Fabric(bending=0.2, thickness=0.008),
            ),
        ),
        shoe=ShoeCut(height=0.080, sole=0.026, heel=0.030),
        shoe_texture=partial(textures.leather, (180, 176, 168), (90, 90, 94), 333, laces=True),
        shoe_roughness=0.7,
        sole=(0.70, 0.70, 0.68),
        hair=HairCut(
            hairline=wardrobe.LONG, thickness=0.022, edge=0.006,
            fall={0.0: 0.0, 52.0: 0.0, 60.0: 0.03, 90.0: 0.06, 180.0: 0.08}, strand=0.4,
        ),
        hair_colour=hair,
        face=wardrobe.face("tan", hair, beard=1.1),
        seed=27,
    )  # fmt: skip


def _camel_coat() -> Outfit:
    hair = (20, 16, 15)
    camel = (178, 134, 84)
    return Outfit(
        shape=BodyShape(
            sex=0.0, age=0.50, muscle=0.48, weight=0.36, height=0.62, proportions=0.9,
            ancestry={"african": 0.7, "caucasian": 0.3}, details={"head/head-oval": 0.4},
        ),
        gait=Gait(phase=0.06, stride=0.88, arm_swing_deg=15.0, elbow_deg=22.0, arm_out_deg=13.0, step_width_m=0.08),
        garments=(
            wardrobe.tights((24, 24, 28), 341),
            wardrobe.skirt(
                "coat-skirt", partial(fabrics.coat_skirt, camel, 343), lower=0.46, flare=0.06, upper=1.0, ease=0.018,
            ),
            wardrobe.top(
                "coat", partial(fabrics.coat, camel, (96, 64, 36), 342, belt=True),
                lower=0.45, ease=0.020, hang=0.6, tube={0.2: 0.072, 1.0: 0.064, 2.0: 0.052},
                collar=wardrobe.TURNED_DOWN, thickness=0.005, roughness=0.9, fabric=_COARSE,
            ),
        ),
        shoe=ShoeCut(height=0.12, sole=0.016, heel=0.040),
        shoe_texture=partial(textures.leather, (26, 22, 22), (20, 18, 18), 344, laces=False),
        shoe_roughness=0.35,
        sole=(0.01, 0.01, 0.01),
        hair=HairCut(hairline=wardrobe.TIED, thickness=0.045, edge=0.022, strand=0.6),
        hair_colour=hair,
        face=wardrobe.face("brown", hair, brow_height=0.0048),
        seed=28,
    )  # fmt: skip


#: Builders of the looks, by the names in specs.
TOWNSPEOPLE: Final[Mapping[str, Callable[[], Outfit]]] = MappingProxyType(
    {
        "teal-headscarf": _teal_headscarf,
        "saffron-turban": _saffron_turban,
        "violet-sari": _violet_sari,
        "grey-suit": _grey_suit,
        "lime-vest": _lime_vest,
        "coral-runner": _coral_runner,
        "azure-jersey": _azure_jersey,
        "denim-jacket": _denim_jacket,
        "camel-coat": _camel_coat,
        **FAMILIES,
    }
)
