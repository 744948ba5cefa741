"""Test the built street with rays and sums."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from urban_street.street.build import StreetContent, StreetPart, build_street
from urban_street.street.layout import layout_street
from urban_street.street.materials import make_materials
from urban_street.street.plan import Placement, StreetLayout, StreetSettings
from urban_street.vehicles.build import dimensions
from valerie.errors import UnknownName

CAMERAS = ((2.5, -12.0, 1.4), (0.6, -12.0, 1.3), (4.6, -12.0, 2.2))


@pytest.fixture(scope="module")
def solid(content: StreetContent) -> trimesh.Trimesh:
    """Return every triangle of the street in the world."""
    positions, faces, count = [], [], 0
    worlds: dict[str, np.ndarray] = {}
    for part in content.parts:
        worlds[part.path] = world = worlds.get(part.path.rpartition(".")[0], np.eye(4)) @ part.transform
        for mesh in part.meshes:
            positions.append(mesh.positions @ world[:3, :3].T + world[:3, 3])
            faces.append(mesh.faces.astype(np.int64) + count)
            count += len(mesh.positions)
    return trimesh.Trimesh(np.concatenate(positions), np.concatenate(faces), process=False, validate=False)


def part_of(content: StreetContent, path: str) -> StreetPart:
    return next(part for part in content.parts if part.path == path)


def points_of(content: StreetContent, path: str) -> np.ndarray:
    """Return every vertex of an object and its parts, in the object's frame."""
    clouds = []
    for part in content.parts:
        if part.path == path:
            clouds += [mesh.positions for mesh in part.meshes]
        elif part.path.startswith(f"{path}."):
            clouds += [mesh.positions @ part.transform[:3, :3].T + part.transform[:3, 3] for mesh in part.meshes]
    return np.concatenate(clouds)


def test_other_seeds_paint_houses_and_roofs_in_other_colours() -> None:
    first, second = make_materials(0), make_materials(1)
    for name in ("render-0", "roof-0", "brick-red"):
        assert first[name].base_color != second[name].base_color


def test_every_placement_becomes_a_part_with_a_shape(content: StreetContent) -> None:
    layout = layout_street(StreetSettings(seed=0))
    objects = [part.path for part in content.parts if part.path.count(".") == 1]
    assert objects == [placement.path for placement in layout.placements]
    with_shape = {".".join(part.path.split(".")[:2]) for part in content.parts if part.meshes}
    assert with_shape == set(objects)


def test_triangles_and_texture_memory_stay_in_budget(content: StreetContent) -> None:
    triangles = sum(len(mesh.faces) for part in content.parts for mesh in part.meshes)
    # Requirements of ours, so that a processor draws a frame in a second and a worker keeps several streets in memory.
    assert 300_000 <= triangles <= 900_000
    images = [texture.image for texture in content.textures.values()]
    assert sum(image.nbytes for image in images) <= 80e6
    assert max(max(image.shape) for image in images) <= 1024


def test_vertices_are_finite_normals_unit_indices_in_range(content: StreetContent) -> None:
    for part in content.parts:
        for mesh in part.meshes:
            assert np.isfinite(mesh.positions).all(), part.path
            assert np.isfinite(mesh.uvs).all(), part.path
            np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1.0, atol=1e-4, err_msg=part.path)
            assert int(mesh.faces.max()) < len(mesh.positions), part.path


def test_normals_look_where_the_faces_turn(content: StreetContent) -> None:
    for part in content.parts:
        for mesh in part.meshes:
            if content.materials[mesh.material].double_sided:
                continue
            corners = mesh.positions[mesh.faces].astype(np.float64)
            turned = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
            against = np.einsum("fk,fk->f", turned, mesh.normals[mesh.faces].mean(axis=1)) < 0.0
            area = 0.5 * np.linalg.norm(turned, axis=1)
            # Slivers at sharp edges: a fiftieth, a requirement of ours.
            assert area[against].sum() <= 0.02 * area.sum(), (part.path, mesh.material)


def test_materials_and_textures_exist_and_none_is_left_over(content: StreetContent) -> None:
    used = {mesh.material for part in content.parts for mesh in part.meshes}
    assert used == set(content.materials)
    assert {name for material in content.materials.values() for name in material.textures} == set(content.textures)
    assert all(name == material.name for name, material in content.materials.items())


def test_nothing_is_brighter_than_white_paint_or_blacker_than_soot(content: StreetContent) -> None:
    for material in content.materials.values():
        assert 0.0 <= min(material.base_color) <= max(material.base_color) <= 1.0
        assert 0.0 <= material.metallic <= 1.0
        assert 0.0 < material.roughness <= 1.0


def test_equal_cars_and_trees_share_their_meshes(content: StreetContent) -> None:
    layout = layout_street(StreetSettings(seed=0))
    by_model: dict[tuple[str, int], set[int]] = {}
    for placement in layout.placements:
        if placement.kind in {"lime", "far-lime", "lamp"}:
            shape = id(part_of(content, placement.path).meshes)
            by_model.setdefault((placement.kind, placement.variant), set()).add(shape)
    assert all(len(shapes) == 1 for shapes in by_model.values())
    assert len(by_model) < sum(p.kind in {"lime", "far-lime", "lamp"} for p in layout.placements)
    bodies = {
        placement.kind: {
            id(part_of(content, f"{other.path}.body").meshes[0].positions)
            for other in layout.placements
            if other.kind == placement.kind and other.y > 40.0
        }
        for placement in layout.placements
        if placement.object_class == "car"
    }
    assert all(len(shapes) <= 1 for shapes in bodies.values())


def test_cars_stand_on_their_wheels_and_keep_their_size(content: StreetContent) -> None:
    kinds = {placement.path: placement.kind for placement in layout_street(StreetSettings(seed=0)).placements}
    for part in content.parts:
        if part.path.startswith("scene.car-") and not part.meshes:
            points = points_of(content, part.path)
            low, high = points.min(axis=0), points.max(axis=0)
            length, _, height = dimensions(kinds[part.path])
            # Within the depth of a bumper and the height of rails on a roof, metres; a side mirror may fold by 3 cm.
            assert abs(low[2]) < 0.005
            assert high[2] == pytest.approx(height, abs=0.08)
            assert high[1] - low[1] == pytest.approx(length, abs=0.08)
            assert np.allclose(low[0], -high[0], atol=0.03)


def test_cars_and_trees_stay_within_their_footprints_near_the_ground(content: StreetContent) -> None:
    layout = layout_street(StreetSettings(seed=0))
    for footprint in layout.footprints:
        if not footprint.path.startswith(("scene.car-", "scene.vegetation-", "scene.pole-")):
            continue
        transform = part_of(content, footprint.path).transform
        world = points_of(content, footprint.path) @ transform[:3, :3].T + transform[:3, 3]
        waist = world[world[:, 2] < 0.7]
        polygon = np.array(footprint.polygon)
        # Twice the depth of a bumper, by which a vehicle may miss its size: a requirement of ours.
        assert (waist[:, :2] >= polygon.min(axis=0) - 0.12).all(), footprint.path
        assert (waist[:, :2] <= polygon.max(axis=0) + 0.12).all(), footprint.path


def test_ground_lies_where_the_layout_says(content: StreetContent, solid: trimesh.Trimesh) -> None:
    places = np.array([(-2.0, 1.0), (2.5, 20.0), (2.5, 60.0), (7.2, 1.2), (2.2, -20.0)])
    origins = np.column_stack([places, np.full(len(places), 1.5)])
    down = np.tile([0.0, 0.0, -1.0], (len(places), 1))
    hits, rays, _ = solid.ray.intersects_location(origins, down, multiple_hits=False)
    heights = {int(ray): float(hit[2]) for hit, ray in zip(hits, rays, strict=True)}
    assert [round(heights[k], 3) for k in range(len(places))] == [0.12, 0.0, 0.0, 0.12, 0.0]


@pytest.mark.parametrize("camera", CAMERAS)
def test_cameras_see_at_least_as_far_as_the_first_parked_car(
    solid: trimesh.Trimesh, camera: tuple[float, float, float]
) -> None:
    hits, _, _ = solid.ray.intersects_location([camera], [(0.0, 1.0, 0.0)], multiple_hits=False)
    assert hits[0][1] > 8.0  # 20 m ahead, a requirement of ours


def test_no_open_horizon_shows_at_either_end(solid: trimesh.Trimesh) -> None:
    angle = np.radians(np.linspace(-25.0, 25.0, 41))
    for towards in (1.0, -1.0):
        directions = np.stack([np.sin(angle), towards * np.cos(angle), np.full_like(angle, 0.01)], -1)
        origins = np.tile([2.5, 10.0, 1.4], (len(angle), 1))
        blocked = solid.ray.intersects_any(origins, directions)
        assert blocked.all()


def test_an_unknown_kind_of_object_is_refused() -> None:
    layout = StreetLayout(
        StreetSettings(), (Placement("scene.car-1", "sedann", 0.0, 0.0),), (), (), (0.0, 0.0, 1.0, 1.0)
    )
    with pytest.raises(UnknownName, match="sedan"):
        build_street(layout)
