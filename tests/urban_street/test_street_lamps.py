"""Test the lamps of the generated street: places, directions, owners."""

import math

import numpy as np
import pytest
import trimesh
from trimesh.ray.ray_pyembree import RayMeshIntersector

from urban_street.street.build import StreetContent
from urban_street.street.furniture import LANTERN, LANTERN_PLACE, lamp_post
from urban_street.street.layout import layout_street
from urban_street.street.plan import StreetSettings
from urban_street.vehicles.build import KINDS, build_vehicle, dimensions
from urban_street.vehicles.lamps import GLOWING, RED, WHITE, vehicle_lamps


def test_a_posts_lamp_hangs_under_its_lens_and_looks_down() -> None:
    (lens,) = [mesh for mesh in lamp_post().meshes() if mesh.material in LANTERN.glowing]
    place = LANTERN_PLACE[:3, 3]
    low, high = lens.positions.min(axis=0), lens.positions.max(axis=0)
    assert (low[:2] < place[:2]).all()
    assert (place[:2] < high[:2]).all()
    assert 0.0 < low[2] - place[2] < 0.1  # the depth of a lantern, metres
    np.testing.assert_allclose(LANTERN_PLACE[:3, 1], (0, 0, -1), atol=1e-12)


def test_the_road_below_a_post_has_the_light_of_a_residential_street() -> None:
    # Brightest below the post; EN 13201 asks for 2 … 15 lx on average (P classes), a third of that.
    assert 5.0 < LANTERN.intensity / LANTERN_PLACE[2, 3] ** 2 < 50.0


def test_every_lamp_post_of_a_street_has_one_lamp_over_the_road(content: StreetContent) -> None:
    layout = layout_street(StreetSettings())
    posts = {placement.path for placement in layout.placements if placement.kind == "lamp"}
    lamps = {part.path: part for part in content.parts if part.light is not None}
    assert {path.removesuffix(".lamp") for path in lamps} == posts
    assert len(posts) >= 165.0 / 30.0  # metres of the street by those between posts, a requirement of ours
    places = {part.path: part.transform for part in content.parts}
    for path, part in lamps.items():
        x = (places[path.removesuffix(".lamp")] @ part.transform)[0, 3]
        post = places[path.removesuffix(".lamp")][0, 3]
        assert abs(x - 2.5) < abs(post - 2.5)  # the middle of the carriageway


@pytest.mark.parametrize("kind", KINDS)
def test_headlamps_look_ahead_and_tail_lamps_back_from_the_ends_of_the_vehicle(kind: str) -> None:
    length, width, height = dimensions(kind)
    lamps = list(vehicle_lamps(build_vehicle(kind), lambda name: f"own/{name}"))
    heads = [lamp for lamp in lamps if lamp.light.glowing == (f"own/{WHITE}",)]
    tails = [lamp for lamp in lamps if lamp.light.glowing == (f"own/{RED}",)]
    assert 1 <= len(heads) <= 2
    assert 1 <= len(tails) <= 2
    assert len({lamp.name for lamp in lamps}) == len(lamps)
    for lamp in lamps:
        x, y, z = lamp.transform[:3, 3]
        ahead = 1.0 if lamp in heads else -1.0
        # Within 8° of straight ahead, in the outer quarter of the vehicle or on a bracket before it: requirements of ours.
        assert lamp.transform[1, 1] * ahead > math.cos(math.radians(8.0))
        assert 0.25 * length < y * ahead < 0.5 * length + 0.2
        assert abs(x) < 0.5 * width
        assert 0.2 < z < height
        assert lamp.light.switch == "car"
    assert all(0.0 > lamp.transform[2, 1] > -math.sin(math.radians(3.0)) for lamp in heads)  # dipped


@pytest.mark.parametrize("kind", KINDS)
def test_headlamps_are_dipped_and_nothing_of_the_vehicle_stands_in_their_beam(kind: str) -> None:
    vehicle = build_vehicle(kind)
    corners = [
        (mesh.positions.astype(np.float64) @ part.transform[:3, :3].T + part.transform[:3, 3])[mesh.faces]
        for part in vehicle.parts
        for mesh in part.meshes
    ]
    soup = np.concatenate(corners).reshape(-1, 3)
    body = RayMeshIntersector(trimesh.Trimesh(soup, np.arange(len(soup)).reshape(-1, 3), process=False))
    heads = [lamp for lamp in vehicle_lamps(vehicle, lambda name: name) if WHITE in lamp.light.glowing]
    for lamp in heads:
        assert lamp.light.beam == "dipped"
        across, up = (part.ravel() for part in np.meshgrid(np.linspace(-0.7, 0.7, 41), np.linspace(-0.5, 0.3, 41)))
        right, ahead, above, place = lamp.transform[:3, :4].T
        rays = across[:, None] * right + ahead + up[:, None] * above
        assert not body.intersects_any(np.broadcast_to(place, rays.shape), rays).any()


def test_the_lenses_that_glow_are_materials_that_vehicles_have() -> None:
    assert build_vehicle("sedan").materials.keys() >= GLOWING
