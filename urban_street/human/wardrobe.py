"""Shared parts of characters: hairlines, collars, skins, and the cuts of common garments."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Final, TypedDict, Unpack

from urban_street.human import textures
from urban_street.human.clothing import Cut
from urban_street.human.drape import Fabric
from urban_street.human.outfits import Garment
from urban_street.human.skin import Face
from urban_street.human.textures import Colour
from urban_street.human.trim import Collar

Paint = Callable[[], textures.TextureCanvas]

# Hairlines by azimuth from the front, degrees.
SHORT: Final = {
    0.0: 41.0, 25.0: 40.0, 42.0: 33.0, 55.0: 20.0, 64.0: 10.0, 72.0: -12.0, 80.0: -14.0, 87.0: 3.0, 108.0: 3.0,
    118.0: -12.0, 180.0: -36.0,
}  # fmt: skip
RECEDED: Final = {
    0.0: 62.0, 25.0: 68.0, 42.0: 58.0, 55.0: 32.0, 64.0: 12.0, 72.0: -10.0, 80.0: -12.0, 87.0: 3.0, 108.0: 3.0,
    118.0: -12.0, 180.0: -34.0,
}  # fmt: skip
LONG: Final = {0.0: 42.0, 18.0: 41.0, 35.0: 34.0, 50.0: 20.0, 60.0: -6.0, 75.0: -10.0, 120.0: -14.0, 180.0: -34.0}
TIED: Final = {
    0.0: 41.0, 25.0: 40.0, 42.0: 34.0, 55.0: 22.0, 66.0: 12.0, 78.0: 2.0, 87.0: 4.0, 108.0: 3.0, 122.0: -10.0,
    180.0: -30.0,
}  # fmt: skip
FRINGE: Final = {0.0: 24.0, 25.0: 23.0, 40.0: 20.0, 52.0: 8.0, 62.0: -6.0, 75.0: -14.0, 120.0: -16.0, 180.0: -36.0}

CREW_NECK: Final = Collar(
    rows=((0.008, 0.0), (0.013, 0.0015), (0.013, 0.0), (0.004, -0.002), (-0.01, -0.003)), opening=0.1
)
STAND_UP: Final = Collar(
    rows=((0.012, 0.001), (0.026, 0.003), (0.038, 0.006), (0.043, 0.005), (0.043, 0.001), (0.034, -0.001), (0.01, -0.003),
          (-0.02, -0.004)),
    opening=0.25,
)  # fmt: skip
TURNED_DOWN: Final = Collar(
    rows=((0.01, 0.0), (0.026, 0.001), (0.032, 0.003), (0.027, 0.007), (0.006, 0.012), (-0.026, 0.016), (-0.026, 0.012),
          (0.0, 0.004)),
    opening=0.25,
    folded=True,
)  # fmt: skip
HOOD: Final = Collar(
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


def face(tone: str, hair: Colour, *, iris: Colour = (62, 42, 28), **more: Unpack[_FaceOptions]) -> Face:
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


def top(name: str, paint: Paint, *, lower: float, k: float = 1.0, **more: Unpack[_TopOptions]) -> Garment:
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
        collar=more.get("collar", CREW_NECK),
    )


def legs(name: str, paint: Paint, *, lower: float, k: float = 1.0, **more: Unpack[_CutOptions]) -> Garment:
    cut = Cut(
        "trousers",
        upper=more.get("upper", 0.76),
        lower=lower,
        ease=more.get("ease", 0.008 * k),
        tube=_scaled(more.get("tube", {0.25: 0.088, 1.0: 0.076, 2.0: 0.072}), k),
        fabric=more.get("fabric", Fabric(bending=0.16)),
    )
    return Garment(name, cut, paint, 0.88, 0.6)


def skirt(name: str, paint: Paint, *, lower: float, flare: float, upper: float = 0.9, ease: float = 0.012) -> Garment:
    tube = {0.0: 0.0, 0.25: 0.12 * flare, 1.0: flare}
    cut = Cut("skirt", upper=upper, lower=lower, ease=ease, tube=tube, fabric=Fabric(bending=0.08, thickness=0.008))
    return Garment(name, cut, paint, 0.85, 0.6, thickness=0.002)


def tights(colour: Colour, seed: int, lower: float = 0.06) -> Garment:
    return legs(
        "tights", partial(textures.trousers, colour, seed), lower=lower, ease=0.003, tube={}, fabric=Fabric(bending=0.3)
    )
