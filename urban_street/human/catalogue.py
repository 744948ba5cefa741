"""The characters: twelve people who differ in sex, age, build, skin, hair and clothes, one of them in two outfits."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from types import MappingProxyType
from typing import Final, TypedDict, Unpack

from urban_street.human import fabrics, textures
from urban_street.human.body import BodyShape
from urban_street.human.clothing import Cut
from urban_street.human.drape import Fabric
from urban_street.human.hair import HairCut
from urban_street.human.hats import Hat
from urban_street.human.outfits import Garment, Outfit, black_outfit, yellow_outfit, yellow_shirt
from urban_street.human.pose import Gait
from urban_street.human.shoes import ShoeCut
from urban_street.human.skin import Face
from urban_street.human.textures import Colour
from urban_street.human.trim import Collar

Paint = Callable[[], textures.TextureCanvas]

# Hairlines by azimuth from the front, degrees.
_SHORT: Final = {
    0.0: 41.0, 25.0: 40.0, 42.0: 33.0, 55.0: 20.0, 64.0: 10.0, 72.0: -12.0, 80.0: -14.0, 87.0: 3.0, 108.0: 3.0,
    118.0: -12.0, 180.0: -36.0,
}  # fmt: skip
_RECEDED: Final = {
    0.0: 62.0, 25.0: 68.0, 42.0: 58.0, 55.0: 32.0, 64.0: 12.0, 72.0: -10.0, 80.0: -12.0, 87.0: 3.0, 108.0: 3.0,
    118.0: -12.0, 180.0: -34.0,
}  # fmt: skip
_LONG: Final = {0.0: 42.0, 18.0: 41.0, 35.0: 34.0, 50.0: 20.0, 60.0: -6.0, 75.0: -10.0, 120.0: -14.0, 180.0: -34.0}
_TIED: Final = {
    0.0: 41.0, 25.0: 40.0, 42.0: 34.0, 55.0: 22.0, 66.0: 12.0, 78.0: 2.0, 87.0: 4.0, 108.0: 3.0, 122.0: -10.0,
    180.0: -30.0,
}  # fmt: skip
_FRINGE: Final = {0.0: 24.0, 25.0: 23.0, 40.0: 20.0, 52.0: 8.0, 62.0: -6.0, 75.0: -14.0, 120.0: -16.0, 180.0: -36.0}

_CREW_NECK: Final = Collar(
    rows=((0.008, 0.0), (0.013, 0.0015), (0.013, 0.0), (0.004, -0.002), (-0.01, -0.003)), opening=0.1
)
_STAND_UP: Final = Collar(
    rows=((0.012, 0.001), (0.026, 0.003), (0.038, 0.006), (0.043, 0.005), (0.043, 0.001), (0.034, -0.001), (0.01, -0.003),
          (-0.02, -0.004)),
    opening=0.25,
)  # fmt: skip
_TURNED_DOWN: Final = Collar(
    rows=((0.01, 0.0), (0.026, 0.001), (0.032, 0.003), (0.027, 0.007), (0.006, 0.012), (-0.026, 0.016), (-0.026, 0.012),
          (0.0, 0.004)),
    opening=0.25,
    folded=True,
)  # fmt: skip
_HOOD: Final = Collar(
    rows=((0.012, 0.006), (0.030, 0.018), (0.040, 0.036), (0.030, 0.052), (0.004, 0.056), (-0.022, 0.048), (-0.03, 0.03),
          (-0.012, 0.012)),
    opening=0.45,
    folded=True,
)  # fmt: skip

_HEADS: Final[Mapping[str, tuple[Colour, Colour]]] = {  # colours of skin and lips
    "pale": ((226, 180, 156), (192, 112, 104)),
    "fair": ((222, 174, 148), (188, 112, 102)),
    "olive": ((196, 148, 112), (164, 98, 86)),
    "tan": ((214, 168, 128), (178, 106, 92)),
    "brown": ((138, 92, 64), (118, 66, 58)),
    "dark": ((92, 60, 44), (92, 52, 48)),
}


class _FaceOptions(TypedDict, total=False):
    """Fields of a face."""

    beard: float
    brow_height: float
    hairline: dict[float, float]


def _face(tone: str, hair: Colour, *, iris: Colour = (62, 42, 28), **more: Unpack[_FaceOptions]) -> Face:
    skin, lips = _HEADS[tone]
    brows = (int(0.75 * hair[0]), int(0.75 * hair[1]), int(0.75 * hair[2]))
    red, green, blue = (int(0.35 * a + 0.65 * b) for a, b in zip(skin, hair, strict=True))
    return Face(skin=skin, lips=lips, brows=brows, iris=iris, scalp=(red, green, blue), **more)


class _CutOptions(TypedDict, total=False):
    """Fields of a cut, for an adult's size of ``tube``."""

    upper: float
    ease: float
    tube: Mapping[float, float]
    fabric: Fabric


class _TopOptions(_CutOptions, total=False):
    """Fields of a top's cut, of its cloth and of its hems."""

    sleeve: float
    hang: float
    roughness: float
    specular: float
    thickness: float
    collar: Collar | None


def _scaled(tube: Mapping[float, float], k: float) -> dict[float, float]:
    return {place: k * radius for place, radius in tube.items()}


def _top(name: str, paint: Paint, *, lower: float, k: float = 1.0, **more: Unpack[_TopOptions]) -> Garment:
    """Return a jacket, sweater or shirt; ``k`` is the body's size relative to an adult's."""
    cut = Cut(
        "top",
        upper=more.get("upper", 0.006 * k),
        lower=lower,
        sleeve=more.get("sleeve", 1.93),
        ease=more.get("ease", 0.012 * k),
        hang=more.get("hang", 0.6),
        tube=_scaled(more.get("tube", {0.2: 0.062, 1.0: 0.055, 2.0: 0.040}), k),
        fabric=more.get("fabric", Fabric()),
    )
    return Garment(
        name,
        cut,
        paint,
        roughness=more.get("roughness", 0.8),
        specular=more.get("specular", 0.7),
        thickness=more.get("thickness", 0.003),
        collar=more.get("collar", _CREW_NECK),
    )


def _legs(name: str, paint: Paint, *, lower: float, k: float = 1.0, **more: Unpack[_CutOptions]) -> Garment:
    cut = Cut(
        "trousers",
        upper=more.get("upper", 0.76),
        lower=lower,
        ease=more.get("ease", 0.008 * k),
        tube=_scaled(more.get("tube", {0.25: 0.088, 1.0: 0.076, 2.0: 0.072}), k),
        fabric=more.get("fabric", Fabric(bending=0.16)),
    )
    return Garment(name, cut, paint, 0.88, 0.6)


def _skirt(name: str, paint: Paint, *, lower: float, flare: float, upper: float = 0.9, ease: float = 0.012) -> Garment:
    tube = {0.0: 0.0, 0.25: 0.12 * flare, 1.0: flare}
    cut = Cut("skirt", upper=upper, lower=lower, ease=ease, tube=tube, fabric=Fabric(bending=0.08, thickness=0.008))
    return Garment(name, cut, paint, 0.85, 0.6, thickness=0.002)


def _tights(colour: Colour, seed: int, lower: float = 0.06) -> Garment:
    return _legs(
        "tights", partial(textures.trousers, colour, seed), lower=lower, ease=0.003, tube={}, fabric=Fabric(bending=0.3)
    )


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
            _tights((44, 38, 40), 31),
            _skirt(
                "coat-skirt",
                partial(fabrics.coat_skirt, (150, 26, 34), 33),
                lower=0.36,
                flare=0.05,
                upper=1.0,
                ease=0.018,
            ),
            _top(
                "coat",
                partial(fabrics.coat, (150, 26, 34), (60, 22, 22), 32),
                lower=0.42,
                ease=0.022,
                hang=0.8,
                tube={0.2: 0.080, 1.0: 0.070, 2.0: 0.055},
                collar=_TURNED_DOWN,
                thickness=0.005,
                roughness=0.9,
                fabric=Fabric(bending=0.2, thickness=0.008),
            ),
        ),
        shoe=ShoeCut(height=0.085, sole=0.020, heel=0.034),
        shoe_texture=partial(textures.leather, (38, 26, 22), (30, 22, 20), 34, laces=False),
        shoe_roughness=0.5,
        sole=(0.01, 0.01, 0.01),
        hair=HairCut(hairline=_TIED, thickness=0.020, edge=0.003, strand=0.3, tied="bun"),
        hair_colour=hair,
        face=_face("pale", hair, iris=(96, 120, 138), brow_height=0.004),
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
            _legs(
                "jeans",
                partial(textures.jeans, (38, 46, 66), (150, 110, 70), 41),
                lower=0.07,
                tube={0.25: 0.084, 1.0: 0.068, 2.0: 0.064},
            ),
            _top(
                "hoodie",
                partial(fabrics.sweater, (128, 130, 134), 42, pocket=True),
                lower=0.16,
                ease=0.018,
                hang=0.7,
                tube={0.2: 0.074, 1.0: 0.064, 2.0: 0.044},
                collar=_HOOD,
                thickness=0.005,
                roughness=0.95,
                fabric=Fabric(bending=0.14, thickness=0.008),
            ),
        ),
        shoe=ShoeCut(height=0.080, sole=0.026, heel=0.030),
        shoe_texture=partial(textures.leather, (200, 44, 38), (240, 240, 238), 43, laces=True),
        shoe_roughness=0.6,
        sole=(0.80, 0.79, 0.77),
        hair=HairCut(hairline=_SHORT, thickness=0.020, edge=0.006, strand=0.5),
        hair_colour=hair,
        face=_face("dark", hair, brow_height=0.0065, hairline=_SHORT),
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
            _top(
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
            _skirt(
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
        hair=HairCut(hairline=_FRINGE, thickness=0.020, edge=0.004, strand=0.2, tied="ponytail"),
        hair_colour=hair,
        face=_face("tan", hair, brow_height=0.0048),
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
            _legs(
                "shorts",
                partial(textures.trousers, (142, 126, 94), 61),
                lower=0.50,
                upper=0.62,
                tube={0.25: 0.110, 1.0: 0.112, 1.3: 0.112},
            ),
            _top(
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
        hair=HairCut(hairline=_SHORT, thickness=0.010, edge=0.0015, strand=0.25),
        hair_colour=hair,
        face=_face("fair", hair, iris=(86, 110, 124), beard=0.7, hairline=_SHORT),
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
            _legs(
                "shorts",
                partial(textures.trousers, (52, 64, 92), 71),
                lower=0.33,
                k=k,
                tube={0.25: 0.096, 1.0: 0.096, 1.2: 0.096},
            ),
            _top(
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
        hair=HairCut(hairline=_FRINGE, thickness=0.018, edge=0.005, strand=0.3),
        hair_colour=hair,
        face=_face("fair", hair, iris=(92, 108, 84), brow_height=0.004),
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
            _tights((58, 54, 92), 81, 0.05),
            _skirt(
                "skirt",
                partial(fabrics.skirt, (84, 62, 128), (240, 240, 240), 82, "pleats"),
                lower=0.36,
                flare=0.09,
                upper=0.7,
                ease=0.010,
            ),
            _top(
                "jacket",
                partial(textures.jacket, (206, 92, 132), (230, 230, 230), 83),
                lower=0.22,
                k=k,
                ease=0.018,
                hang=0.7,
                tube={0.2: 0.076, 1.0: 0.068, 2.0: 0.048},
                collar=_STAND_UP,
                thickness=0.004,
                roughness=0.6,
                fabric=Fabric(bending=0.16, thickness=0.007),
            ),
        ),
        shoe=ShoeCut(height=0.070, sole=0.018, heel=0.020),
        shoe_texture=partial(textures.leather, (226, 222, 214), (206, 92, 132), 84, laces=True),
        shoe_roughness=0.5,
        sole=(0.80, 0.78, 0.76),
        hair=HairCut(hairline=_TIED, thickness=0.018, edge=0.003, strand=0.3, tied="ponytail"),
        hair_colour=hair,
        face=_face("olive", hair, brow_height=0.004),
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
            _legs(
                "trousers",
                partial(textures.trousers, (86, 70, 56), 91),
                lower=0.055,
                upper=0.86,
                tube={0.25: 0.098, 1.0: 0.090, 2.0: 0.084},
            ),
            _top(
                "jacket",
                partial(textures.jacket, (168, 148, 112), (130, 120, 90), 92),
                lower=0.02,
                ease=0.022,
                hang=0.85,
                tube={0.2: 0.080, 1.0: 0.070, 2.0: 0.052},
                collar=_TURNED_DOWN,
                thickness=0.004,
                fabric=Fabric(bending=0.16, thickness=0.008),
            ),
        ),
        shoe=ShoeCut(height=0.080, sole=0.016, heel=0.028),
        shoe_texture=partial(textures.leather, (72, 44, 26), (50, 32, 20), 93, laces=True),
        shoe_roughness=0.4,
        sole=(0.03, 0.02, 0.015),
        hair=HairCut(hairline=_RECEDED, thickness=0.008, edge=0.0015, strand=0.3),
        hair_colour=hair,
        face=_face("fair", hair, iris=(104, 122, 132), beard=0.5, hairline=_RECEDED),
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
            _legs(
                "trousers",
                partial(textures.trousers, (36, 34, 38), 101),
                lower=0.06,
                tube={0.25: 0.100, 1.0: 0.080, 2.0: 0.070},
            ),
            _top(
                "parka",
                partial(textures.jacket, (66, 82, 52), (150, 140, 96), 102),
                lower=-0.25,
                ease=0.026,
                hang=0.85,
                tube={0.2: 0.092, 1.0: 0.082, 2.0: 0.058},
                collar=_HOOD,
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
            hairline=_LONG,
            thickness=0.014,
            edge=0.006,
            fall={0.0: 0.0, 52.0: 0.0, 60.0: 0.06, 90.0: 0.09, 180.0: 0.10},
            strand=0.4,
        ),
        hair_colour=hair,
        face=_face("brown", hair, brow_height=0.0055),
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
            _legs(
                "trousers",
                partial(textures.trousers, (58, 60, 66), 111),
                lower=0.055,
                tube={0.25: 0.094, 1.0: 0.086, 2.0: 0.080},
            ),
            _skirt("coat-skirt", partial(fabrics.coat_skirt, navy, 113), lower=0.52, flare=0.05, upper=1.0, ease=0.022),
            _top(
                "coat",
                partial(fabrics.coat, navy, (14, 14, 18), 112, belt=True),
                lower=0.45,
                ease=0.024,
                hang=0.8,
                tube={0.2: 0.084, 1.0: 0.074, 2.0: 0.055},
                collar=_TURNED_DOWN,
                thickness=0.005,
                roughness=0.9,
                fabric=Fabric(bending=0.2, thickness=0.008),
            ),
        ),
        shoe=ShoeCut(height=0.078, sole=0.014, heel=0.030),
        shoe_texture=partial(textures.leather, (18, 16, 16), (12, 12, 12), 114, laces=True),
        shoe_roughness=0.25,
        sole=(0.01, 0.01, 0.01),
        hair=HairCut(hairline=_RECEDED, thickness=0.012, edge=0.0015, strand=0.25),
        hair_colour=hair,
        face=_face("fair", hair, beard=0.3, hairline=_RECEDED),
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
            _legs(
                "trousers",
                partial(fabrics.tee, (214, 92, 26), (206, 206, 200), 121, "block"),
                lower=0.06,
                tube={0.25: 0.104, 1.0: 0.098, 2.0: 0.092},
            ),
            _top(
                "jacket",
                partial(fabrics.tee, (222, 98, 24), (206, 206, 200), 122, "block"),
                lower=0.05,
                ease=0.020,
                hang=0.8,
                tube={0.2: 0.082, 1.0: 0.072, 2.0: 0.052},
                collar=_STAND_UP,
                thickness=0.004,
                roughness=0.75,
                fabric=Fabric(bending=0.16, thickness=0.008),
            ),
        ),
        shoe=ShoeCut(height=0.11, sole=0.028, heel=0.034),
        shoe_texture=partial(textures.leather, (50, 40, 32), (30, 26, 22), 123, laces=True),
        shoe_roughness=0.7,
        sole=(0.03, 0.03, 0.03),
        hair=HairCut(hairline=_SHORT, thickness=0.012, edge=0.0015, strand=0.22),
        hair_colour=hair,
        face=_face("olive", hair, beard=0.9, hairline=_SHORT),
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
    }
)

#: Names of the characters.
CHARACTERS: Final = tuple(LOOKS)
