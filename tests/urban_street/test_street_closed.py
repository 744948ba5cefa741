"""Test with rays that streets are closed: nothing in the air of a street sees an underside, or the ground below the street."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import shapely

from tests.unit.rendering.scene_rays import pixel_rays
from tests.urban_street.ground_rays import Street, assert_closed
from urban_street.street.build import build_street
from urban_street.street.layout import layout_street
from urban_street.street.plan import StreetLayout, StreetSettings
from valerie.rendering.base import View
from valerie.rendering.ground_truth import TruthPass
from valerie.scene.assets.asset import SceneAsset
from valerie.scene.graph.model import Camera
from valerie.scene.graph.transforms import camera_transform
from valerie.scene.variation.variant import apply

#: The plane below and around everything.
OUTSKIRTS = "scene.terrain-1"
#: Streets that differ in every argument that shapes the ground.
STREETS: tuple[dict[str, Any], ...] = (
    {"seed": 0},
    {"seed": 1, "side_street": "both", "lanes": 2, "setback_m": 2.5, "pavement_width_m": 4.0, "kerb_height_m": 0.05},
    {"seed": 2, "side_street": "left", "lanes": 3, "surface": "paving", "length_m": 120.0, "kerb_height_m": 0.2},
    {"seed": 3, "side_street": "none", "season": "winter", "pavement_width_m": 1.8, "length_m": 200.0},
)


def street_of(arguments: dict[str, Any]) -> Street:
    layout = layout_street(StreetSettings(**arguments))
    lines = layout.lines
    air = ((lines.left_front, lines.row_start + 1.0, 0.25), (lines.right_front, lines.row_stop - 1.0, 3.0))
    return Street.of(layout, build_street(layout), air, covered(layout), OUTSKIRTS)


def covered(layout: StreetLayout) -> shapely.Geometry:
    """Return the ground below the street, its side streets and its houses."""
    lines = layout.lines
    shapes = [shapely.box(lines.left_front, lines.road_start - 6.0, lines.right_front, lines.road_stop)]
    houses = (footprint for footprint in layout.footprints if footprint.path.startswith("scene.building-"))
    shapes += [shapely.Polygon(house.polygon) for house in houses]
    for placement in layout.placements:
        if placement.kind in {"side-road", "side-footway"}:
            (length, width), x, y = placement.size[:2], placement.x, placement.y
            shapes.append(shapely.box(x, y - 0.5 * width, x + length, y + 0.5 * width))
    return shapely.union_all(shapes)


@pytest.mark.parametrize("arguments", STREETS, ids=lambda arguments: f"seed {arguments['seed']}")
def test_no_ray_finds_an_underside_of_the_ground_or_a_gap(arguments: dict[str, Any]) -> None:
    assert_closed(street_of(arguments), 60_000, seed=7)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(20))
def test_no_ray_of_a_million_finds_an_underside_of_the_ground_or_a_gap(seed: int) -> None:
    assert_closed(street_of({**STREETS[seed % len(STREETS)], "seed": seed}), 1_400_000, seed=seed)


@pytest.mark.gl
def test_no_pixel_of_the_truth_shows_the_ground_below_the_street(asset: SceneAsset, truth_pass: TruthPass) -> None:
    # An edge that meets the middle of another would leave pixels between them: a rasteriser rounds vertices, rays do not.
    scene, view, rng = apply({}, asset), View("camera-1", 480, 270), np.random.default_rng(0)
    pixels = 0
    for _ in range(8):
        place = float(rng.uniform(-3.0, 8.0)), float(rng.uniform(-15.0, 60.0)), float(rng.uniform(1.2, 2.5))
        transform = camera_transform(place, float(rng.uniform(-40.0, 40.0)), float(rng.uniform(-10.0, 0.0)), 0.0)
        camera = Camera("scene.camera-1", transform, 35.0)
        truth = truth_pass.truth(replace(scene, cameras={"camera-1": camera}), view)
        visible = np.isfinite(truth.depth)
        points = camera.position + pixel_rays(camera, view)[visible] * truth.depth[visible][:, None]
        low, high = (-12.0, -33.0, -0.08), (17.0, 138.0, -0.0575)
        pixels += int(((points > low) & (points < high)).all(axis=1).sum())
    assert pixels == 0
