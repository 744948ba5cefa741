"""All materials and textures of a street. Its seed chooses some of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from urban_street.street import species
from urban_street.street.houses import DOOR_COLORS, RENDER_COLORS, ROOF_COLORS
from urban_street.street.plan import Season, StreetSettings, lines_of
from urban_street.street.textures import ground, rooms, sprays, surfacing, things, walls
from valerie.scene.graph.deferred import DeferredTexture, deferred_textures
from valerie.scene.graph.model import Material, Rooms, Texture

Color = tuple[float, float, float]

#: Linear reflectances.
_RENDERS: tuple[Color, ...] = (
    (0.68, 0.58, 0.40), (0.72, 0.66, 0.55), (0.60, 0.42, 0.28), (0.50, 0.54, 0.50), (0.70, 0.50, 0.40),
    (0.42, 0.48, 0.54), (0.75, 0.73, 0.68), (0.66, 0.60, 0.30), (0.46, 0.52, 0.38), (0.56, 0.30, 0.22),
    (0.55, 0.53, 0.50), (0.62, 0.47, 0.45),
)  # fmt: skip
_DOORS: tuple[Color, ...] = (
    (0.03, 0.07, 0.045), (0.09, 0.04, 0.02), (0.02, 0.035, 0.08), (0.16, 0.02, 0.02), (0.05, 0.05, 0.055),
    (0.22, 0.20, 0.17),
)  # fmt: skip
_ROOFS: tuple[Color, ...] = ((0.36, 0.13, 0.075), (0.13, 0.13, 0.14), (0.24, 0.12, 0.085), (0.10, 0.09, 0.085))
#: Materials of carriageways. Each has a texture of the same name.
_SURFACES = ("asphalt-0", "asphalt-1", "asphalt-crossing", "asphalt-side")
_BINS: tuple[Color, ...] = ((0.03, 0.033, 0.036), (0.02, 0.06, 0.16), (0.30, 0.22, 0.02))
_AWNINGS: tuple[Color, ...] = ((0.34, 0.03, 0.025), (0.02, 0.13, 0.07), (0.03, 0.06, 0.22))


def make_textures(settings: StreetSettings) -> dict[str, Texture]:
    """Return all textures. Each is computed when first read; equal settings give equal pixels."""
    streams = iter(np.random.default_rng(s) for s in np.random.SeedSequence([settings.seed, 7001]).spawn(24))
    textures = _carriageways(settings, [next(streams) for _ in range(3)])
    next(streams)  # unused, but drawn so that the colours of each seed stay the same
    textures |= _one("turf", partial(ground.turf, next(streams)))
    for names, make in (
        (("paving", "paving-normal", "paving-roughness"), ground.paving),
        (("brick-red", "brick-buff", "brick-normal", "brick-roughness"), walls.brick),
        (("render", "render-normal", "render-roughness"), walls.render),
        (("ashlar", "ashlar-normal"), walls.ashlar),
        (("roof", "roof-normal"), walls.roof_tiles),
    ):
        textures |= deferred_textures(names, partial(make, next(streams)))
    for name, make_one in (
        ("interiors", walls.interiors), ("boards", walls.boards), ("bark", things.bark), ("hedge", things.hedge),
        ("granite", walls.granite),
    ):  # fmt: skip
        textures |= _one(name, partial(make_one, next(streams)))
    textures |= _one("shop-boards", things.shop_boards)
    return textures | _mixed(settings) | _surfacing(settings) | _rooms(settings)


def _rooms(settings: StreetSettings) -> dict[str, Texture]:
    """Return the rooms behind windows."""
    first, second = (np.random.default_rng(s) for s in np.random.SeedSequence([settings.seed, 7010]).spawn(2))
    return _one("flats", partial(rooms.flats, first)) | _one("shops", partial(rooms.shops, second))


def _one(name: str, make: Callable[[], ground.Image]) -> dict[str, Texture]:
    return {name: DeferredTexture(name, make)}


def _carriageways(settings: StreetSettings, streams: Sequence[np.random.Generator]) -> dict[str, Texture]:
    """Return colour, normals and roughness of carriageways of asphalt or setts.

    Args:
        streams: sources of random numbers for three surfaces of asphalt.
    """
    lines = lines_of(settings)
    own = [np.random.default_rng(s) for s in np.random.SeedSequence([settings.seed, 7005]).spawn(4)]
    names = [name for name in _SURFACES if name != "asphalt-side" or lines.side_y is not None]

    def surface(
        make: Callable[..., Sequence[ground.Image]], rng: np.random.Generator, name: str
    ) -> Sequence[ground.Image]:
        if name == "asphalt-side":
            return make(rng, zebra=False, lane=())
        return make(rng, zebra=name == "asphalt-crossing", lane=lines.lanes, width=lines.width)

    textures: dict[str, Texture] = {}
    if settings.surface == "paving":
        for rng, name in zip(own, names, strict=False):
            images = (name, f"{name}-normal", f"{name}-roughness")
            textures |= deferred_textures(images, partial(surface, ground.setts, rng, name))
        return textures
    for rng, name in zip((*streams, own[0]), names, strict=False):
        textures |= deferred_textures((name, f"{name}-roughness"), partial(surface, ground.asphalt, rng, name))
    rng = np.random.default_rng(np.random.SeedSequence([settings.seed, 7008]))
    return textures | deferred_textures(
        [f"{name}-normal" for name in names],
        lambda: [ground.relief(textures[name].image, rng, lines.width) for name in names],
    )


def _mixed(settings: StreetSettings) -> dict[str, Texture]:
    """Return the bark of some species, and posters."""
    rng = np.random.default_rng(np.random.SeedSequence([settings.seed, 7007]))
    barks = ("plane", "birch", "cherry")

    def make() -> list[ground.Image]:
        return [*(things.bark_of(rng, kind) for kind in barks), things.posters(rng)]

    names = [*(f"bark-{kind}" for kind in barks), "posters"]
    return deferred_textures(names, make)


#: Linear colours of grass, and of fields of young grain and of stubble, in summer.
_GRASS: Color = (0.105, 0.150, 0.042)
_FIELDS: dict[str, Color] = {"crops": (0.115, 0.185, 0.045), "stubble": (0.36, 0.27, 0.12)}


def _surfacing(settings: StreetSettings) -> dict[str, Texture]:
    """Return the surfaces of the ground of places."""
    streams = iter(np.random.default_rng(s) for s in np.random.SeedSequence([settings.seed, 7009]).spawn(9))
    textures: dict[str, Texture] = {}
    for name, tracks in (("asphalt-lane", True), ("asphalt-open", False)):
        make = partial(surfacing.asphalt, next(streams), surfacing.TILES[name], tracks=tracks)
        textures |= deferred_textures(_maps(name), make)
    textures |= deferred_textures(_maps("slabs"), partial(surfacing.slabs, next(streams)))
    textures |= _one("road-marking", partial(surfacing.marking, next(streams)))
    textures |= _one("verge", partial(surfacing.verge, next(streams), leaf_color(_GRASS, settings.season)))
    for name, color in _FIELDS.items():
        textures |= _one(name, partial(surfacing.crops, next(streams), leaf_color(color, settings.season)))
    textures |= _one("gravel", partial(surfacing.gravel, next(streams)))
    textures |= _one("hatching", partial(surfacing.hatching, next(streams)))
    return textures | _one("exit-boards", things.exit_boards)


def _maps(name: str) -> tuple[str, str, str]:
    return name, f"{name}-normal", f"{name}-roughness"


def foliage_textures(settings: StreetSettings) -> dict[str, Texture]:
    """Return the leaves of trees and hedges, and the bark of pines."""

    def rng(k: int) -> np.random.Generator:
        return np.random.default_rng(np.random.SeedSequence([settings.seed, 7009, k]))

    textures = _one("bark-pine", lambda: things.bark_of(rng(0), "pine"))
    for k, (kind, leaf) in enumerate(_sprays().items()):
        textures |= _one(
            f"spray-{kind}", partial(lambda k, leaf: sprays.spray(leaf, settings.season, rng(k)), k + 1, leaf)
        )
    return textures


def foliage_materials(season: Season = "summer") -> dict[str, Material]:
    """Return the materials of trees and hedges."""
    materials = [
        *(Material(f"bark-of-{kind}", tint, texture, roughness=0.92) for kind, (texture, tint) in _barks().items()),
        Material("hedge-core", (0.42, 0.42, 0.42), "hedge", roughness=0.9),
        Material("stake", (0.62, 0.50, 0.36), "boards", roughness=0.85),
        Material("strap", (0.03, 0.03, 0.03), roughness=0.8),
    ]
    for kind, leaf in _sprays().items():
        through = species.TRANSLUCENCY if leaf.evergreen or season != "winter" else 0.0
        for name, tone in ((f"spray-{kind}", 1.0), (f"spray-{kind}-shade", 0.8)):
            materials.append(
                Material(
                    name, (tone, tone, tone), f"spray-{kind}", roughness=0.8, specular=0.3, alpha_cutoff=sprays.CUTOFF,
                    double_sided=True, translucency=through,
                )
            )  # fmt: skip
    return {material.name: material for material in materials}


def _sprays() -> dict[str, species.Leaf]:
    return {kind: tree.leaf for kind, tree in species.SPECIES.items()} | {"hedge": species.HEDGE_LEAF}


def _barks() -> dict[str, tuple[str, Color]]:
    return {kind: tree.bark for kind, tree in species.SPECIES.items()}


#: Factors of red, green and blue of a leaf's linear colour, by season.
_SEASONS: dict[Season, Color] = {
    "spring": (1.35, 1.25, 1.05), "summer": (1.0, 1.0, 1.0), "autumn": (3.4, 1.05, 0.75), "winter": (1.6, 0.8, 0.9),
}  # fmt: skip


def leaf_color(summer: Color, season: Season) -> Color:
    """Return the linear colour in a season of leaves with the colour ``summer`` in summer."""
    red, green, blue = (value * factor for value, factor in zip(summer, _SEASONS[season], strict=True))
    return red, green, blue


def make_materials(seed: int) -> dict[str, Material]:
    """Return all materials. The seed chooses the colours of render, doors and roofs."""
    rng = np.random.default_rng(np.random.SeedSequence([seed, 7002]))
    materials = [
        *_ground(),
        *_walls(rng),
        Material("tyre", (0.022, 0.022, 0.023), roughness=0.85),
        Material("slats", (0.34, 0.19, 0.09), "boards", roughness=0.6),
        Material("cabinet", (0.19, 0.21, 0.20), metallic=0.1, roughness=0.55),
        Material("poster", (1.0, 1.0, 1.0), "posters", roughness=0.4),
        Material("stop-green", (0.01, 0.17, 0.06), roughness=0.5),
        Material("stop-yellow", (0.75, 0.52, 0.02), roughness=0.5),
        Material("hedge", (1.0, 1.0, 1.0), "hedge", roughness=0.9, soaks=1.0),
        Material("steel", (0.26, 0.27, 0.28), metallic=0.6, roughness=0.55),
        Material("iron", (0.022, 0.025, 0.024), metallic=0.3, roughness=0.5),
        Material("zinc", (0.30, 0.31, 0.32), metallic=0.4, roughness=0.6),
        Material("metal", (0.55, 0.50, 0.36), metallic=0.9, roughness=0.35),
        Material("lens", (0.70, 0.70, 0.68), roughness=0.3),
        Material("lantern", (0.70, 0.70, 0.68), roughness=0.3),
        Material("shop-board", (1.0, 1.0, 1.0), "shop-boards", roughness=0.6),
        Material("signal-red", (0.5, 0.02, 0.01), roughness=0.25, emissive=(0.9, 0.03, 0.015), signal=True),
        Material("signal-amber", (0.5, 0.2, 0.01), roughness=0.25, emissive=(0.95, 0.42, 0.015), signal=True),
        Material("signal-green", (0.02, 0.4, 0.2), roughness=0.25, emissive=(0.03, 0.85, 0.42), signal=True),
        Material("delineator", (0.66, 0.66, 0.64), roughness=0.5),
        Material("exit-board", (1.0, 1.0, 1.0), "exit-boards", roughness=0.45),
        Material("reflector-red", (0.55, 0.02, 0.015), roughness=0.2),
        Material("reflector", (0.62, 0.60, 0.52), roughness=0.2),
        Material("galvanised", (0.44, 0.45, 0.46), metallic=0.7, roughness=0.5),
        Material("signal-off", (0.03, 0.035, 0.03), roughness=0.25),
        Material("visor", (0.02, 0.02, 0.02), roughness=0.7, double_sided=True),
        Material("planter", (0.16, 0.10, 0.06), "boards", roughness=0.85),
        *(Material(f"bin-{k}", color, roughness=0.6) for k, color in enumerate(_BINS)),
        *(Material(f"awning-{k}", color, roughness=0.9, double_sided=True) for k, color in enumerate(_AWNINGS)),
        Material("awning-white", (0.72, 0.70, 0.64), roughness=0.9, double_sided=True),
    ]  # fmt: skip
    return {material.name: material for material in materials}


def _ground() -> list[Material]:
    white = (1.0, 1.0, 1.0)
    return [
        *(
            Material(
                name,
                white,
                name,
                f"{name}-normal",
                f"{name}-roughness",
                metallic=1.0,
                roughness=1.0,
                traffic=1.0,
            )
            for name in _SURFACES
        ),
        Material("road-paint", (0.55, 0.54, 0.51), roughness=0.7),
        Material("paving", white, "paving", "paving-normal", "paving-roughness", roughness=1.0, traffic=0.5),
        Material("kerb", (0.36, 0.35, 0.33), "granite", roughness=0.8),
        Material("joint", (0.06, 0.057, 0.05), roughness=0.95),
        Material("turf", white, "turf", roughness=0.95, soaks=1.0),
        Material("asphalt-lane", white, *_maps("asphalt-lane"), roughness=1.0, traffic=1.0),
        *(Material(name, white, *_maps(name), roughness=1.0) for name in ("asphalt-open", "slabs")),
        Material("road-marking", white, "road-marking", roughness=0.72),
        *(Material(name, white, name, roughness=0.95, soaks=1.0) for name in ("verge", "crops", "stubble", "gravel")),
        Material("hatching", white, "hatching", roughness=0.95),
        Material("grass", white, "verge", roughness=0.8, double_sided=True, soaks=1.0),
    ]


def _walls(rng: np.random.Generator) -> list[Material]:
    renders = rng.permutation(len(_RENDERS))[:RENDER_COLORS]
    doors = rng.permutation(len(_DOORS))[:DOOR_COLORS]
    roofs = rng.permutation(len(_ROOFS))[:ROOF_COLORS]
    white = (1.0, 1.0, 1.0)
    brick_red, brick_buff = _shifted((0.82, 0.82, 0.82), rng), _shifted((0.8, 0.8, 0.8), rng)
    stone = _shifted((0.52, 0.48, 0.42), rng)
    return [
        Material("brick-red", brick_red, "brick-red", "brick-normal", "brick-roughness", roughness=1.0),
        Material("brick-buff", brick_buff, "brick-buff", "brick-normal", "brick-roughness", roughness=1.0),
        *(
            Material(f"render-{k}", _shifted(_RENDERS[pick], rng), "render", "render-normal", "render-roughness", roughness=1.0)
            for k, pick in enumerate(renders)
        ),
        Material("render-side", (0.44, 0.41, 0.36), "render", "render-normal", "render-roughness", roughness=1.0),
        Material("stucco", (0.74, 0.71, 0.64), "render", roughness=0.85),
        Material("stone", stone, "granite", roughness=0.85),
        Material("timber", (0.10, 0.060, 0.036), "boards", roughness=0.85),
        Material("concrete", (0.50, 0.49, 0.47), "granite", roughness=0.88),
        Material("slate", (0.15, 0.16, 0.18), "roof", "roof-normal", roughness=0.6),
        Material("zinc-roof", (0.36, 0.38, 0.41), "boards", metallic=0.25, roughness=0.5),
        Material("ashlar", (0.72, 0.66, 0.56), "ashlar", "ashlar-normal", roughness=0.88),
        *(
            Material(f"roof-{k}", _shifted(_ROOFS[pick], rng), "roof", "roof-normal", roughness=0.85)
            for k, pick in enumerate(roofs)
        ),
        *(Material(f"door-{k}", _DOORS[pick], "boards", roughness=0.4) for k, pick in enumerate(doors)),
        Material("frame-white", (0.74, 0.74, 0.72), roughness=0.45),
        Material("frame-dark", (0.035, 0.037, 0.04), roughness=0.5),
        *(
            Material(f"{name}-glass", white, "interiors", roughness=0.06, specular=1.6, rooms=behind)
            for name, behind in (
                ("window", Rooms("flats", rooms.FLAT[0], rooms.FLAT[2], 9.0)),
                ("shop", Rooms("shops", rooms.SHOP[0], rooms.SHOP[2], 14.0)),
            )
        ),
    ]  # fmt: skip


def _shifted(color: Color, rng: np.random.Generator) -> Color:
    """Return a slightly brighter or darker, warmer or colder colour."""
    red, green, blue = np.clip(np.array(color) * rng.normal(1.0, 0.05) * rng.normal(1.0, 0.025, 3), 0.0, 1.0)
    return float(red), float(green), float(blue)
