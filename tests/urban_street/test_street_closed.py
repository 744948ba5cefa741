"""Test with rays that streets are closed: nothing in the air of a street sees an underside, or the ground below the street."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
import shapely
import trimesh
from numpy.typing import NDArray
from trimesh.ray.ray_pyembree import RayMeshIntersector

from tests.unit.rendering.scene_rays import pixel_rays
from urban_street.street.build import StreetContent, build_street
from urban_street.street.layout import layout_street
from urban_street.street.plan import StreetLayout, StreetSettings
from valerie.rendering.base import View
from valerie.rendering.ground_truth import TruthPass
from valerie.scene.assets.asset import SceneAsset
from valerie.scene.graph.model import Camera
from valerie.scene.graph.transforms import camera_transform
from valerie.scene.variation.variant import apply

Floats = NDArray[np.float64]

#: Surfaces seen from behind that one ray passes.
_MOST_BEHIND = 12
GROUND = ("scene.road-", "scene.sidewalk-", "scene.terrain-")
#: The plane below and around everything.
OUTSKIRTS = "scene.terrain-1"
#: Streets that differ in every argument that shapes the ground.
STREETS: tuple[dict[str, Any], ...] = (
    {"seed": 0},
    {"seed": 1, "side_street": "both", "lanes": 2, "setback_m": 2.5, "pavement_width_m": 4.0, "kerb_height_m": 0.05},
    {"seed": 2, "side_street": "left", "lanes": 3, "surface": "paving", "length_m": 120.0, "kerb_height_m": 0.2},
    {"seed": 3, "side_street": "none", "season": "winter", "pavement_width_m": 1.8, "length_m": 200.0},
)


@dataclass(frozen=True, eq=False)
class Street:
    """The triangles of a street in the world, and which of them an engine draws from behind."""

    layout: StreetLayout
    intersector: RayMeshIntersector
    corners: Floats
    normals: Floats
    two_sided: NDArray[np.bool_]
    owners: NDArray[np.intp]
    names: list[tuple[str, str]]

    @classmethod
    def of(cls, layout: StreetLayout, content: StreetContent) -> Street:
        corners, owners, two_sided, names = [], [], [], []
        worlds: dict[str, Floats] = {}
        for part in content.parts:
            world = worlds.get(part.path.rpartition(".")[0], np.eye(4)) @ part.transform
            worlds[part.path] = world
            for mesh in part.meshes:
                corners.append((mesh.positions @ world[:3, :3].T + world[:3, 3])[mesh.faces])
                owners.append(np.full(len(mesh.faces), len(names)))
                two_sided.append(np.full(len(mesh.faces), content.materials[mesh.material].double_sided))
                names.append((part.path, mesh.material))
        soup = np.concatenate(corners)
        mesh = trimesh.Trimesh(
            soup.reshape(-1, 3), np.arange(3 * len(soup)).reshape(-1, 3), process=False, validate=False
        )
        normals = np.cross(soup[:, 1] - soup[:, 0], soup[:, 2] - soup[:, 0])
        return cls(
            layout, RayMeshIntersector(mesh), soup, normals, np.concatenate(two_sided), np.concatenate(owners), names
        )

    def air(self, count: int, rng: np.random.Generator) -> Floats:
        """Return places between the fronts, up to 3 m high, that no obstacle takes, (≤ count, 3)."""
        lines = self.layout.lines
        low = [lines.left_front, lines.row_start + 1.0, 0.25]
        places = rng.uniform(low, [lines.right_front, lines.row_stop - 1.0, 3.0], (count, 3))
        occupied = shapely.union_all([shapely.Polygon(f.polygon) for f in self.layout.footprints]).buffer(0.25)
        shapely.prepare(occupied)
        return places[~shapely.contains_xy(occupied, places[:, 0], places[:, 1])]

    def ground_edges(self, count: int, rng: np.random.Generator) -> Floats:
        """Return places on edges of the ground's triangles, (count, 3)."""
        mine = np.array([path.startswith(GROUND) and path != OUTSKIRTS for path, _ in self.names])
        triangles = self.corners[mine[self.owners]]
        start = rng.integers(3, size=count)
        chosen = triangles[rng.integers(len(triangles), size=count)]
        one, other = chosen[np.arange(count), start], chosen[np.arange(count), (start + 1) % 3]
        points: Floats = one + rng.random((count, 1)) * (other - one)
        return points

    def facing(self, hit: NDArray[np.intp], directions: Floats) -> NDArray[np.bool_]:
        """Return (N,) bool, True where a ray meets nothing, or a side that engines draw."""
        front = (self.normals[hit] * directions).sum(axis=1) <= 0.0
        return (hit < 0) | self.two_sided[hit] | front

    def meets(self, hit: NDArray[np.intp], origins: Floats, directions: Floats) -> Floats:
        """Return the places where rays meet the triangles ``hit``, (N, 3)."""
        normals = self.normals[hit]
        way = ((self.corners[hit, 0] - origins) * normals).sum(axis=1) / (directions * normals).sum(axis=1)
        places: Floats = origins + directions * way[:, None]
        return places

    def first(self, origins: Floats, directions: Floats) -> NDArray[np.intp]:
        """Return the triangle that each ray meets first, −1 for none."""
        hit: NDArray[np.intp] = self.intersector.intersects_first(origins, directions)
        return hit

    def drawn(self, origins: Floats, directions: Floats) -> tuple[NDArray[np.intp], Floats]:
        """Return the triangle that an engine draws for each ray, −1 for none, and where the last part of the ray begins."""
        origins, hit = origins.copy(), self.first(origins, directions)
        for _ in range(_MOST_BEHIND):
            behind = np.flatnonzero(~self.facing(hit, directions))
            places = self.meets(hit[behind], origins[behind], directions[behind])
            origins[behind] = places + 1e-4 * directions[behind]
            hit[behind] = self.first(origins[behind], directions[behind])
        return hit, origins

    def gaps(self, hit: NDArray[np.intp], starts: Floats, directions: Floats) -> NDArray[np.bool_]:
        """Return (N,) bool, True for rays of `drawn` that see the outskirts where the street or a house covers them."""
        leaks = (hit >= 0) & np.array([path == OUTSKIRTS for path, _ in self.names])[self.owners[hit]]
        leaks[leaks] = self.covered(self.meets(hit[leaks], starts[leaks], directions[leaks]))
        return leaks

    def covered(self, places: Floats) -> NDArray[np.bool_]:
        """Return (N,) bool, True for places below the street, its side streets or its houses."""
        lines = self.layout.lines
        shapes = [shapely.box(lines.left_front, lines.road_start - 6.0, lines.right_front, lines.road_stop)]
        houses = (footprint for footprint in self.layout.footprints if footprint.path.startswith("scene.building-"))
        shapes += [shapely.Polygon(house.polygon) for house in houses]
        for placement in self.layout.placements:
            if placement.kind in {"side-road", "side-footway"}:
                (length, width), x, y = placement.size[:2], placement.x, placement.y
                shapes.append(shapely.box(x, y - 0.5 * width, x + length, y + 0.5 * width))
        inside: NDArray[np.bool_] = shapely.contains_xy(shapely.union_all(shapes), places[:, 0], places[:, 1])
        return inside


def assert_closed(street: Street, rays: int, seed: int) -> None:
    """Half of the rays look anywhere, half at edges of the ground, where parts meet."""
    rng = np.random.default_rng(seed)
    origins = street.air(rays, rng)
    directions = rng.normal(size=origins.shape)
    directions[:, 2] *= rng.choice([1.0, 0.2, 0.05], len(origins))
    aimed = len(origins) // 2
    # Beside the edges by more than the arithmetic of single precision.
    targets = street.ground_edges(aimed, rng) + rng.normal(scale=1e-5, size=(aimed, 3))
    directions[:aimed] = targets - origins[:aimed]
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)

    anywhere = street.first(origins[aimed:], directions[aimed:])
    undersides = anywhere[~street.facing(anywhere, directions[aimed:])]
    counts = Counter(street.names[owner] for owner in street.owners[undersides])
    assert not [name for name in counts if name[0].startswith(GROUND)], counts.most_common(20)

    hit, starts = street.drawn(origins, directions)
    # What a ray reaches before it is 60 m away on the ground is part of the street.
    steep = directions[:, 2] < -3.2 / 60.0 * np.linalg.norm(directions[:, :2], axis=1)
    assert not (hit[steep] < 0).any()
    gaps = street.gaps(hit, starts, directions)
    # In single precision a ray in a million slips through an edge that two triangles share. A gap has a width: of eight rays half
    # a millimetre aside, more than one finds it too. Narrower ones would show in the pixels of the last test.
    beside = np.repeat(origins[gaps], 8, axis=0) + rng.normal(scale=5e-4, size=(8 * int(gaps.sum()), 3))
    along = np.repeat(directions[gaps], 8, axis=0)
    hit, starts = street.drawn(beside, along)
    again = street.gaps(hit, starts, along).reshape(-1, 8).sum(axis=1) > 1
    assert not again.any(), street.meets(hit, starts, along).reshape(-1, 8, 3)[again, 0].round(3).tolist()


def street_of(arguments: dict[str, Any]) -> Street:
    layout = layout_street(StreetSettings(**arguments))
    return Street.of(layout, build_street(layout))


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
