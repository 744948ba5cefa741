"""Test the trees: meshes, size, leaves by season, what is cut out, and the street that has them."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from urban_street.street.foliage import build_tree, cards, clad
from urban_street.street.layout import layout_street
from urban_street.street.materials import foliage_materials, make_materials
from urban_street.street.plan import Season, StreetSettings
from urban_street.street.species import HEDGE_LEAF, SPECIES
from urban_street.street.textures.sprays import CELL, CUTOFF, spray
from valerie.color import srgb_to_linear
from valerie.scene.assets.asset import load_asset
from valerie.scene.graph.model import Mesh

EVERGREEN = {"spruce", "pine"}


@lru_cache
def tree(kind: str, *, far: bool = False) -> tuple[Mesh, ...]:
    species = SPECIES[kind].from_afar() if far else SPECIES[kind]
    return build_tree(species, np.random.default_rng(3), kind).meshes()


def is_foliage(mesh: Mesh) -> bool:
    return (
        foliage_materials()[mesh.material].alpha_cutoff is not None if mesh.material in foliage_materials() else False
    )


@lru_cache
def card(kind: str, season: Season) -> NDArray[np.uint8]:
    return spray(SPECIES[kind].leaf, season, np.random.default_rng(3))


def covered(image: NDArray[np.uint8], level: int = 0) -> float:
    """Return the share of texels that are not cut, at a mip level that a box filter made."""
    alpha = image[..., 3].astype(np.float64) / 255.0
    for _ in range(level):
        alpha = alpha.reshape(alpha.shape[0] // 2, 2, alpha.shape[1] // 2, 2).mean(axis=(1, 3))
    return float(np.mean(alpha >= CUTOFF))


@pytest.mark.parametrize("kind", SPECIES)
def test_a_tree_is_finite_stands_on_the_ground_and_keeps_to_its_size(kind: str) -> None:
    shape = SPECIES[kind].shape
    for mesh in tree(kind):
        assert np.isfinite(mesh.positions).all()
        np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1.0, atol=1e-4)
        assert mesh.faces.max() < len(mesh.positions)
        assert mesh.material in make_materials(0) | foliage_materials()
    wood = np.concatenate([mesh.positions for mesh in tree(kind) if mesh.material.startswith("bark-of-")])
    foot = wood[wood[:, 2] < 0.05]
    assert wood[:, 2].min() > -0.12
    assert (wood[:, 2] < 0.0).sum() >= 11  # a whole ring, so there is no gap above the ground
    assert np.hypot(foot[:, 0], foot[:, 1]).max() < 0.4  # within the footprint of a trunk and its flare, metres
    leaves = np.concatenate([mesh.positions for mesh in tree(kind) if is_foliage(mesh)])
    assert np.quantile(np.hypot(leaves[:, 0], leaves[:, 1]), 0.995) < shape.radius + 0.4 * shape.leaf
    assert np.hypot(leaves[:, 0], leaves[:, 1]).max() < shape.radius + 0.9 * shape.leaf
    assert 0.9 * shape.height < leaves[:, 2].max() < 1.08 * shape.height


@pytest.mark.parametrize("kind", SPECIES)
def test_no_card_floats(kind: str) -> None:
    """Wood ends at the middle of each card's foot: the second of its nine vertices."""
    wood = cKDTree(np.concatenate([mesh.positions for mesh in tree(kind) if mesh.material.startswith("bark-of-")]))
    for mesh in tree(kind):
        if is_foliage(mesh):
            feet = mesh.positions.reshape(-1, 9, 3)[:, 1]
            assert wood.query(feet)[0].max() < 0.02  # metres: the thickness of a twig


@pytest.mark.parametrize("kind", SPECIES)
def test_cards_from_afar_are_fewer(kind: str) -> None:
    def cards(*, far: bool) -> int:
        return sum(len(mesh.faces) for mesh in tree(kind, far=far) if is_foliage(mesh))

    assert 0.4 < cards(far=True) / cards(far=False) < 0.7


@pytest.mark.parametrize("kind", SPECIES)
def test_leaves_by_season(kind: str) -> None:
    share = {season: covered(card(kind, season)) for season in ("spring", "summer", "autumn", "winter")}  # type: ignore[arg-type]
    if kind in EVERGREEN:
        assert len(set(share.values())) == 1
        return
    assert share["winter"] < 0.08  # twigs only
    assert share["winter"] < 0.5 * share["autumn"] < 0.5 * share["summer"]
    if kind != "cherry":  # in blossom
        assert share["spring"] < share["summer"]


@pytest.mark.parametrize("kind", SPECIES)
def test_coarser_levels_keep_coverage_and_colour(kind: str) -> None:
    """What an engine that filters alpha cuts: the same share of area at a half and a quarter of the resolution."""
    image = card(kind, "summer")
    assert 0.1 < covered(image) < 0.75
    for level in (1, 2):
        # A requirement of ours; the worst are needles, a texel or two wide.
        assert covered(image, level) == pytest.approx(covered(image), rel=0.08)
    seen = image[..., 3] >= 255 * CUTOFF
    linear = srgb_to_linear(image[..., :3] / 255.0)
    # Levels mix in the colour of cut texels near leaves, which must not be lighter or darker.
    np.testing.assert_allclose(linear[~seen].mean(axis=0), linear[seen].mean(axis=0), rtol=0.25)


def test_cells_do_not_touch() -> None:
    for image in (
        card("plane", "summer"),
        card("willow", "summer"),
        spray(HEDGE_LEAF, "summer", np.random.default_rng(0)),
    ):
        cells = image[..., 3].reshape(image.shape[0] // CELL, CELL, image.shape[1] // CELL, CELL)
        assert not cells[:, [0, -1]].any()
        assert not cells[..., [0, -1]].any()


@pytest.mark.parametrize("kind", SPECIES)
def test_a_card_holds_its_spray(kind: str) -> None:
    """Its outline in the texture leaves out what is empty, and hardly a leaf."""
    one, up = np.ones((1, 3)) * [0.0, 0.0, 1.0], np.ones((1, 3)) * [0.0, -1.0, 0.0]
    uvs = cards(np.zeros((1, 3)), one, up, np.ones(1), up, np.random.default_rng(0)).uvs
    cell = np.floor(uvs[4] * 2.0)
    outline = shapely.Polygon((uvs[[0, 2, 5, 8, 6, 3]] * 2.0 - cell) * CELL)
    columns, rows = np.meshgrid(np.arange(CELL) + 0.5, np.arange(CELL) + 0.5)
    outside = ~shapely.contains_xy(outline, columns, rows)
    assert outside.mean() > 0.2
    drawn = card(kind, "summer").reshape(2, CELL, 2, CELL, 4).transpose(0, 2, 1, 3, 4)[..., 3] >= 255 * CUTOFF
    assert (drawn & outside).sum() / drawn.sum() < 0.02


def test_greenery_keeps_to_its_box() -> None:
    low, high = np.array([-0.3, 0.0, 0.0]), np.array([0.3, 3.0, 0.9])
    for mesh in clad(low, high, 40.0, 0.09, np.random.default_rng(1)).meshes():
        assert (mesh.positions.min(axis=0) > low - 0.25).all()
        assert (mesh.positions.max(axis=0) < high + 0.25).all()


def test_a_street_has_several_kinds_of_trees() -> None:
    placements = layout_street(StreetSettings(seed=4)).placements
    kinds = {p.kind.removeprefix("far-") for p in placements if p.object_class == "vegetation"}
    assert len(kinds & SPECIES.keys()) >= 5
    assert kinds <= {*SPECIES, "hedge", "planter"}


def test_a_street_has_only_the_materials_of_its_trees() -> None:
    materials = load_asset("urban-street").base.materials
    sprays = [material for name, material in materials.items() if name.startswith("spray-")]
    assert sprays
    for material in sprays:
        assert material.double_sided
        assert material.light_through > 0.4
