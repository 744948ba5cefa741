"""Cameras inside things and persons out of view, at places that can be computed by hand."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import trimesh

from valerie.parameters.definitions import ParameterDefinition
from valerie.scene.assets.asset import SceneAsset
from valerie.scene.checks import Doubt
from valerie.scene.checks.shapes import object_boxes
from valerie.scene.checks.views import enclosure, in_view, view_findings
from valerie.scene.graph.model import Camera
from valerie.scene.graph.transforms import camera_transform
from valerie.scene.variation.variant import apply
from valerie.testing.assets import simple_asset


def moved(**cameras: tuple[Any, ...]) -> SceneAsset:
    """The simple asset with its first camera somewhere else: position, yaw, pitch."""
    asset = simple_asset()
    (place,) = cameras.values()
    camera = replace(asset.base.cameras["camera-1"], transform=camera_transform(*place, 0.0))
    fixed = tuple(p for p in asset.manifest.parameters if not p.path.startswith("scene.camera"))
    manifest = asset.manifest.model_copy(update={"cameras": ("camera-1",), "parameters": fixed})
    return SceneAsset(manifest, asset.digest, replace(asset.base, cameras={"camera-1": camera}))


def findings(asset: SceneAsset) -> list[Doubt]:
    return list(view_findings(apply({}, asset), asset))


def middle_of(path: str) -> tuple[float, float, float]:
    low, high = object_boxes(apply({}, simple_asset()))[path]
    x, y, z = (low + high) / 2
    return float(x), float(y), float(z)


def test_a_camera_inside_a_building_is_reported() -> None:
    doubts = [f for f in findings(moved(camera=(middle_of("scene.building-1"), 0.0, 0.0))) if f.code == "inside-solid"]
    assert [(f.where, "scene.building-1" in f.message) for f in doubts] == [("scene.camera-1", True)]


def test_a_camera_just_outside_of_a_building_is_fine() -> None:
    x, y, z = middle_of("scene.building-1")
    outside = (x, y - 3.05, z)
    assert not [f for f in findings(moved(camera=(outside, 180.0, 0.0))) if f.code == "inside-solid"]


def test_a_camera_below_the_ground_is_reported() -> None:
    (found,) = [f for f in findings(moved(camera=((0.0, 0.0, -5.0), 0.0, 0.0))) if f.code == "inside-solid"]
    assert (found.value, found.limit) == ("z = -5 m", "0 m")


def test_a_person_behind_every_camera_by_default_is_reported_with_the_visible_share_of_its_range() -> None:
    # From (0, 10.5) along +y: person-1 stands at (0, 10), and may stand at y up to 50.
    doubts = [f for f in findings(moved(camera=((0.0, 11.0, 1.5), 0.0, 0.0))) if f.code == "out-of-view"]
    assert [f.where for f in doubts] == ["scene.person-1"]
    assert "of its range is in view" in doubts[0].message
    assert "outside the image" in doubts[0].message


def test_a_person_that_no_camera_can_see_is_reported() -> None:
    (found,) = findings(moved(camera=((0.0, 5.0, 1.5), 0.0, 89.0)))
    assert found.where == "scene.person-1"
    assert "anywhere in its range" in found.message


def test_a_person_without_range_is_judged_at_its_place() -> None:
    asset = moved(camera=((0.0, 5.0, 1.5), 0.0, 89.0))
    fixed: tuple[ParameterDefinition, ...] = tuple(p for p in asset.manifest.parameters if ".pos." not in p.path)
    asset = SceneAsset(asset.manifest.model_copy(update={"parameters": fixed}), asset.digest, asset.base)
    (found,) = findings(asset)
    assert "range" not in found.message


@pytest.mark.parametrize("yaw", [-20.0, 0.0, 20.0, 28.0, 180.0])
def test_a_box_is_in_view_exactly_within_the_angle_of_the_lens(yaw: float) -> None:
    # 36 mm behind a lens of 36 mm: 53.13° across. A thin box straight ahead at 10 m leaves the picture at 26.57°.
    camera = Camera("scene.camera-1", camera_transform((0.0, 0.0, 1.0), yaw, 0.0, 0.0), 36.0)
    box = np.array([[-0.01, 9.99, 0.0], [0.01, 10.01, 2.0]])
    assert in_view(camera, box) == (abs(yaw) < math.degrees(math.atan(0.5)))


def test_a_box_around_the_camera_is_in_view() -> None:
    camera = Camera("scene.camera-1", camera_transform((0.0, 0.0, 1.0), 0.0, 0.0, 0.0), 36.0)
    assert in_view(camera, np.array([[-5.0, -5.0, -5.0], [5.0, 5.0, 5.0]]))


@pytest.mark.parametrize(("radius", "expected"), [(0.0, 1.0), (0.9, 1.0), (1.1, 0.0), (5.0, 0.0)])
def test_a_closed_surface_encloses_the_points_inside(radius: float, expected: float) -> None:
    ball = trimesh.creation.icosphere(subdivisions=3)
    point = radius * np.array([0.48, 0.6, 0.64])
    assert enclosure(point, np.asarray(ball.triangles)) == pytest.approx(expected, abs=1e-9)


def test_an_open_box_encloses_its_middle_by_the_solid_angle_of_its_remaining_sides() -> None:
    box = trimesh.creation.box(extents=(2.0, 2.0, 2.0))
    without_floor = np.asarray(box.triangles)[np.asarray(box.face_normals)[:, 2] > -0.5]
    assert enclosure(np.zeros(3), without_floor) == pytest.approx(5 / 6)  # each side of a cube takes a sixth
