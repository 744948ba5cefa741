"""Test the effect of each argument of the generated street on triangles and textures, and that nothing else changes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from numpy.typing import NDArray

from urban_street.street.build import StreetContent, build_street
from urban_street.street.layout import layout_street
from urban_street.street.plan import Placement, StreetSettings
from valerie.scene.assets.asset import asset_manifest

Points = NDArray[np.float64]


def built(settings: StreetSettings, placements: tuple[Placement, ...] | None = None) -> StreetContent:
    """Build the ground of a street and each side's three houses nearest to y = 20 m, or only ``placements``."""
    layout = layout_street(settings)
    if placements is None:
        houses = [p for p in layout.placements if p.object_class == "building"]
        near = [
            sorted((p for p in houses if (p.x > 2.5) == right), key=lambda p: abs(p.y - 20.0))[:3] for right in (0, 1)
        ]
        ground = [p for p in layout.placements if p.object_class in {"road", "sidewalk"}]
        placements = (*ground, *near[0], *near[1])
    return build_street(replace(layout, placements=placements))


def points(content: StreetContent, *starts: str, material: str = "") -> Points:
    """Return the (N, 3) world vertices of objects whose paths begin with a prefix."""
    clouds = [
        mesh.positions.astype(np.float64) @ part.transform[:3, :3].T + part.transform[:3, 3]
        for part in content.parts
        if part.path.startswith(starts)
        for mesh in part.meshes
        if mesh.material.startswith(material)
    ]
    return np.concatenate(clouds) if clouds else np.zeros((0, 3))


@lru_cache
def measured(**arguments: object) -> Mapping[str, float | tuple[float, ...]]:
    """Return metres to the centimetre; fronts of houses to the quarter of a metre, since sills and steps stand out."""
    content = built(StreetSettings.model_validate(arguments))
    road, zebra = points(content, "scene.road-1"), points(content, "scene.road-1", material="asphalt-crossing")
    left, right = float(road[:, 0].min()), float(road[:, 0].max())
    paving = [points(content, f"scene.sidewalk-{number}", material="paving") for number in (1, 2)]
    houses = points(content, "scene.building-")
    low = houses[(houses[:, 2] < 2.0) & (houses[:, 2] > 0.5)]
    roads = points(content, "scene.road-")
    mouth = roads[np.abs(roads[:, 1] - 46.0) < 3.5]
    y = np.unique(zebra[:, 1].round(3))
    pieces = np.split(y, np.flatnonzero(np.diff(y) > 5.0) + 1)
    edges = paving[0][:, 0].min(), paving[1][:, 0].max()
    gaps = edges[0] - low[low[:, 0] < 2.5, 0].max(), low[low[:, 0] > 2.5, 0].min() - edges[1]
    exact = {
        "left kerb": left,
        "right kerb": right,
        "left pavement": left - edges[0],
        "right pavement": edges[1] - right,
        "height of the pavements": float(paving[0][:, 2].max()),
        "end of the road": float(road[:, 1].max()),
        "side street to the left": left - float(mouth[:, 0].min()),
        "side street to the right": float(mouth[:, 0].max()) - right,
    }
    return {
        **{name: round(value, 2) + 0.0 for name, value in exact.items()},
        "front gardens": tuple(round(4.0 * float(gap)) / 4.0 + 0.0 for gap in gaps),
        "zebra crossings": tuple(round(float(0.5 * (piece[0] + piece[-1])), 2) for piece in pieces),
    }


DEFAULT: dict[str, float | tuple[float, ...]] = {
    "left kerb": -0.8,
    "right kerb": 5.8,  # two parking bays of 2.1 m and a lane of 2.4 m about x = 2.5 m
    "left pavement": 2.8,
    "right pavement": 2.8,
    "height of the pavements": 0.12,
    "end of the road": 139.2,  # 165 m of houses from y = -27 m on, and 1.2 m to the cross street
    "side street to the left": 0.0,
    "side street to the right": 48.8,
    "front gardens": (0.0, 0.0),
    "zebra crossings": (0.0, 39.6, 105.6),
}


def test_the_default_street_has_the_documented_measures() -> None:
    assert measured() == DEFAULT


@pytest.mark.parametrize(
    ("arguments", "changes"),
    [
        ({"lanes": 2}, {"left kerb": -3.2}),
        ({"lanes": 3}, {"left kerb": -3.2, "right kerb": 8.2}),
        ({"lane_width_m": 3.4}, {"left kerb": -1.3, "right kerb": 6.3}),
        ({"pavement_width_m": 4.0}, {"left pavement": 4.0, "right pavement": 4.0, "side street to the right": 50.0}),
        ({"kerb_height_m": 0.18}, {"height of the pavements": 0.18}),
        ({"setback_m": 4.0}, {"front gardens": (4.0, 4.0), "side street to the right": 52.8}),
        ({"length_m": 200.0}, {"end of the road": 174.2}),
        (
            {"side_street": "none"},
            {"side street to the right": 0.0, "zebra crossings": (0.0, 66.0)},
        ),
        ({"side_street": "left"}, {"side street to the left": 48.8, "side street to the right": 0.0}),
        ({"side_street": "both"}, {"side street to the left": 48.8}),
    ],
    ids=str,
)
def test_an_argument_changes_its_own_measures_and_no_other(
    arguments: dict[str, object], changes: dict[str, float | tuple[float, ...]]
) -> None:
    measures = measured(**arguments)
    different = {name: value for name, value in measures.items() if value != DEFAULT[name]}
    assert different == changes


def one_of(settings: StreetSettings, kind: str) -> StreetContent:
    layout = layout_street(settings)
    return built(settings, (next(p for p in layout.placements if p.kind.removeprefix("far-") == kind),))


def leaves(season: str) -> tuple[float, float]:
    """Return the share of a plane tree's cards that its leaves and twigs cover, and their red minus their green."""
    content = one_of(StreetSettings.model_validate({"season": season, "seed": 1}), "plane")  # seed 0 has none
    names = {mesh.material for part in content.parts for mesh in part.meshes}
    assert any(name.startswith("bark") for name in names)
    (texture,) = {content.materials[name].base_color_texture for name in names if name.startswith("spray")}
    assert texture is not None
    image = content.textures[texture].image.astype(np.float64)
    seen = image[..., 3] > 127
    red, green, _ = image[seen][:, :3].mean(axis=0)
    return float(seen.mean()), float(red - green)


def test_trees_are_green_in_summer_turn_in_autumn_and_are_bare_in_winter() -> None:
    (summer, green), (autumn, turned), (winter, _) = (leaves(season) for season in ("summer", "autumn", "winter"))
    # Grey levels of the mean colour, a requirement of ours.
    assert green < -10.0
    assert turned > 10.0
    assert 0 < autumn < summer
    assert winter < 0.08  # twigs only


def test_a_road_of_setts_has_joints_and_domes() -> None:
    settings = StreetSettings(surface="paving", side_street="none")
    layout = layout_street(settings)
    content = built(settings, (next(p for p in layout.placements if p.kind == "carriageway"),))
    name = content.materials["asphalt-0"].normal_texture
    assert name is not None
    normals = content.textures[name].image[..., :3].astype(np.float64) / 127.5 - 1.0
    tilted = np.hypot(normals[..., 0], normals[..., 1]) > np.tan(np.deg2rad(10.0)) * normals[..., 2]
    # Joints and rims of domes: a requirement of ours, three times what asphalt has.
    assert tilted.mean() > 0.15


def test_a_street_has_more_than_six_styles_of_houses_that_differ_in_geometry() -> None:
    settings = StreetSettings(seed=2, length_m=300.0)
    layout = layout_street(settings)
    kinds = {p.kind: p for p in layout.placements if p.object_class == "building" and 0.0 < p.y < 270.0}
    content = built(settings, tuple(kinds.values()))
    # Styles differ in geometry: heights of floors and roofs to the decimetre, and lower edges of windows.
    glass = [
        np.concatenate([m.positions for m in part.meshes if m.material == "window-glass"]) for part in content.parts
    ]
    assert len({frozenset(panes[:, 2].round(1).tolist()) for panes in glass}) > 6


def test_as_many_persons_can_vary_as_are_asked_for() -> None:
    manifest = asset_manifest({"name": "urban-street", "persons": 4})[0]
    assert manifest.persons == tuple(f"scene.person-{number}" for number in (1, 2, 3, 4))
    assert {"scene.person-4.pos.x", "scene.person-4.character"} <= set(manifest.by_path)
