"""Test layouts under the street's arguments, and the houses, trees and furniture in them."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np
import pytest
import shapely

from urban_street.solids.surfaces import Bag
from urban_street.street import amenities
from urban_street.street.house_styles import BUILDERS
from urban_street.street.layout import layout_street
from urban_street.street.materials import leaf_color, make_materials
from urban_street.street.plan import Placement, StreetLayout, StreetSettings, lines_of
from urban_street.street.rows import HOUSE_STYLES
from urban_street.street.species import SPECIES
from urban_street.street.textures import ground
from valerie.errors import InvalidInputs
from valerie.labels import label_of_node_class
from valerie.scene.assets.asset import asset_manifest

STREETS = {
    "default": StreetSettings(),
    "boulevard": StreetSettings(
        seed=2, length_m=300.0, lanes=4, lane_width_m=3.25, pavement_width_m=5.0, setback_m=3.0, side_street="both",
    ),
    "left turn": StreetSettings(seed=1, lanes=2, lane_width_m=3.0, side_street="left", kerb_height_m=0.08),
    "narrow": StreetSettings(seed=3, length_m=100.0, pavement_width_m=1.8, side_street="right"),
}  # fmt: skip


@pytest.fixture(scope="module", params=STREETS)
def layout(request: pytest.FixtureRequest) -> StreetLayout:
    return layout_street(STREETS[request.param])


def shapes(layout: StreetLayout) -> dict[str, shapely.Polygon]:
    return {footprint.path: shapely.Polygon(footprint.polygon) for footprint in layout.footprints}


def height(layout: StreetLayout, x: float, y: float) -> float:
    level = 0.0
    for region in layout.ground:
        if shapely.Polygon(region.polygon).contains(shapely.Point(x, y)):
            level = region.height
    return level


def against_their_faces(bag: Bag) -> float:
    """Return the share of the area with normals against the faces' winding; cloth and leaves have two sides.

    Slivers at sharp edges may have a hundredth of it, a requirement of ours.
    """
    materials = make_materials(0)
    bad = total = 0.0
    for mesh in bag.meshes():
        if materials[mesh.material].double_sided:
            continue
        corners = mesh.positions[mesh.faces].astype(np.float64)
        turned = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        away = np.einsum("fk,fk->f", turned, mesh.normals[mesh.faces].mean(axis=1)) < 0.0
        area = 0.5 * np.linalg.norm(turned, axis=1)
        bad, total = bad + float(area[away].sum()), total + float(area.sum())
    return bad / total


@pytest.mark.parametrize("lanes", [1, 2, 3, 4, 5, 6])
@pytest.mark.parametrize("width", [2.4, 3.25])
def test_the_camera_of_the_driver_is_in_the_middle_of_a_lane(lanes: int, width: float) -> None:
    lines = lines_of(StreetSettings(lanes=lanes, lane_width_m=width))
    middles = [lines.left_kerb + 0.5 * (a + b) for a, b in zip(lines.lanes[:-1], lines.lanes[1:], strict=True)]
    assert min(abs(middle - 2.5) for middle in middles) == pytest.approx(0.0, abs=1e-9)
    assert lines.width == pytest.approx(4.2 + lanes * width)


def test_no_two_solid_things_overlap(layout: StreetLayout) -> None:
    polygons = shapes(layout)
    names = list(polygons)
    left, right = shapely.STRtree(list(polygons.values())).query(list(polygons.values()), predicate="intersects")
    for a, b in zip(left, right, strict=True):
        if a < b:
            # Square metres: a post's base at a kerb, a requirement of ours.
            assert polygons[names[a]].intersection(polygons[names[b]]).area < 0.02, (names[a], names[b])


def test_paths_are_unique_and_classes_are_labels(layout: StreetLayout) -> None:
    assert max(Counter(placement.path for placement in layout.placements).values()) == 1
    assert all(label_of_node_class(placement.object_class).id > 0 for placement in layout.placements)


def test_all_lanes_are_free(layout: StreetLayout) -> None:
    lines = layout.lines
    road = shapely.box(
        lines.left_kerb + lines.lanes[0] + 0.25, -25.0, lines.left_kerb + lines.lanes[-1] - 0.25, lines.row_stop - 2.0
    )
    assert [path for path, polygon in shapes(layout).items() if polygon.intersects(road)] == []


def test_houses_line_the_whole_street_but_for_the_side_streets(layout: StreetLayout) -> None:
    lines = layout.lines
    houses = shapely.union_all(
        [polygon for path, polygon in shapes(layout).items() if path.startswith("scene.building")]
    )
    for left in (True, False):
        x = lines.front(left=left) + (-4.0 if left else 4.0)
        line = shapely.LineString([(x, lines.row_start), (x, lines.row_stop)])
        gap = 10.8 if lines.sides[0 if left else 1] else 0.0
        assert line.difference(houses).length == pytest.approx(gap, abs=0.05)


def test_a_side_street_is_level_with_the_road_and_free(layout: StreetLayout) -> None:
    lines = layout.lines
    for left, there in zip((True, False), lines.sides, strict=True):
        kerb = lines.left_kerb - 1.0 if left else lines.right_kerb + 1.0
        assert height(layout, kerb, 46.0) == (0.0 if there else lines.kerb_height)
        assert height(layout, kerb, 30.0) == lines.kerb_height
        if there:
            mouth = shapely.box(min(kerb, 40.0 * np.sign(kerb)), 43.1, max(kerb, 40.0 * np.sign(kerb)), 48.9)
            assert not any(polygon.intersects(mouth) for polygon in shapes(layout).values())


def test_a_street_shows_every_style_of_house_and_what_belongs_to_a_street() -> None:
    boulevards = [layout_street(STREETS["boulevard"].model_copy(update={"seed": seed})) for seed in range(3)]
    kinds = {placement.kind.removeprefix("far-") for layout in boulevards for placement in layout.placements}
    assert len(kinds & SPECIES.keys()) >= 6
    assert kinds >= set(HOUSE_STYLES)
    assert kinds >= {
        "bench",
        "litter-bin",
        "stand",
        "shelter",
        "stop-flag",
        "guard-rail",
        "mast",
        "bollard",
        "lamp",
    }


def test_arguments_out_of_range_name_the_field() -> None:
    with pytest.raises(InvalidInputs, match="length_m"):
        asset_manifest({"name": "urban-street", "length_m": 400})


def test_an_argument_at_its_default_leaves_the_digest_alone() -> None:
    plain = asset_manifest("urban-street")[1]
    assert asset_manifest({"name": "urban-street", "lanes": 1})[1] == plain
    assert asset_manifest({"name": "urban-street", "lanes": 2})[1] != plain


@pytest.mark.parametrize("kind", BUILDERS)
@pytest.mark.parametrize("floors", [3, 5])
def test_houses_face_outwards_and_keep_off_the_pavement_where_people_walk(kind: str, floors: int) -> None:
    width = 10.0 if kind == "timber" else 13.0
    bag = BUILDERS[kind](
        Placement("scene.building-1", kind, 0.0, 0.0, seed=floors, size=(width, 11.0, 5, 2), variant=floors)
    )
    points = np.concatenate([mesh.positions for mesh in bag.meshes()])
    assert against_their_faces(bag) < 0.01
    low = points[points[:, 2] < 2.0]
    # Requirements of ours: steps and sills reach 20 cm out below two metres, three floors are higher than 8 m, and at the back
    # the eaves hang over by half a metre.
    assert low[:, 1].min() > -0.2
    assert points[:, 2].max() > 8.0
    assert points[:, 1].max() < 11.0 + 0.5


@pytest.mark.parametrize("kind", BUILDERS)
def test_windows_lie_behind_the_face_of_the_wall(kind: str) -> None:
    bag = BUILDERS[kind](Placement("scene.building-1", kind, 0.0, 0.0, seed=1, size=(10.0, 11.0, 4, 1), variant=3))
    glass = next(mesh for mesh in bag.meshes() if mesh.material == "window-glass")
    front = glass.normals[:, 1] < -0.99  # within 8°
    assert glass.positions[front, 1].min() > -0.1  # metres: the deepest frame that stands out
    assert len({round(float(y), 2) for y in glass.positions[front, 1]}) > 1 or kind == "mansard"


@pytest.mark.parametrize("build", [
    amenities.bench, amenities.litter_bin, amenities.bicycle_stand, amenities.shelter, amenities.stop_flag,
    amenities.advertising_column, amenities.tree_pit, amenities.mast,
])  # fmt: skip
def test_street_furniture_faces_outwards_and_does_not_sink(build: object) -> None:
    bag = build()  # type: ignore[operator]
    assert against_their_faces(bag) < 0.01
    assert min(float(mesh.positions[:, 2].min()) for mesh in bag.meshes()) > -0.03  # metres: the earth in a tree pit


def test_leaves_turn_from_green_to_yellow_and_red() -> None:
    green = (0.08, 0.18, 0.03)
    assert leaf_color(green, "summer") == green
    red, greens, _ = leaf_color(green, "autumn")
    assert red > greens


def test_cracks_and_seams_of_a_road_picture_are_grooves_in_its_normals() -> None:
    color = np.full((1024, 1024, 3), 110, np.uint8)
    color[:, 500:504] = 40
    normals = ground.relief(color, np.random.default_rng(0)).astype(np.float64) / 127.5 - 1.0
    # Seen from its middle, the groove's left wall faces right and its right wall faces left.
    left, right = normals[:, 494:501, 0].mean(), normals[:, 503:510, 0].mean()
    # Sines of angles: 5° and more on the walls, and a mean of 1° or less elsewhere, where noise alone tilts the surface.
    assert left > math.sin(math.radians(5.0))
    assert right < -math.sin(math.radians(5.0))
    assert abs(normals[:, 100:400, 0].mean()) < math.sin(math.radians(1.0))
