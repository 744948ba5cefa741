"""The light of near surfaces, against rays that are traced through a street with a sunlit red wall."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.unit.rendering.scene_rays import Triangles, blocked, triangles_of
from valerie.rendering.base import View
from valerie.rendering.raster.light.shadows import even_directions
from valerie.rendering.raster.renderer import RasterRenderer
from valerie.rendering.raster.upload.nearby import nearby
from valerie.rendering.raster.upload.surroundings import Reflected, SurfaceSample
from valerie.rendering.sky import sky_of
from valerie.scene.graph.model import Camera, Environment, Material, Node, Scene, Sun
from valerie.scene.graph.transforms import camera_transform
from valerie.testing.assets import box_mesh

GREY, RED = (0.4, 0.4, 0.4), (0.7, 0.1, 0.1)
DIRECTIONS = even_directions(32)
#: Largest factor between the engine's light and that of rays, a requirement of ours.
FACTOR = 1.55


def street() -> Scene:
    """Return two blocks of a street. High walls shade the road from a sun at 45°, and the walls opposite are sunlit.

    The road is at −6 < x < 6. The sunlit wall is red in the block around y = 0, and grey in that around y = 60.
    """
    boxes = {"road": [((-8, -15, -1), (8, 75, 0), "grey")]}
    for name, y, material in (("red", 0, "red"), ("far", 60, "grey")):
        boxes[name] = [((-7, y - 15, 0), (-6, y + 15, 10), "grey"), ((6, y - 15, 0), (7, y + 15, 12), material)]
    nodes = [
        Node(f"scene.{name}-1", np.eye(4), tuple(box_mesh(*box) for box in parts), label_id=11)
        for name, parts in boxes.items()
    ]
    materials = {
        name: Material(name, color, roughness=1.0, specular=0.0) for name, color in {"grey": GREY, "red": RED}.items()
    }
    cameras = {
        f"camera-{number}": Camera(
            f"scene.camera-{number}", camera_transform((2.0, y, 4.0), 0, -90, 0), focal_length_mm=60.0
        )
        for number, y in enumerate((0.0, 60.0), start=1)
    }
    return Scene(
        {node.path: node for node in nodes}, materials, {}, cameras, Sun(math.radians(270), math.radians(45)),
        Environment(sky_strength=0.0),
    )  # fmt: skip


def arriving(scene: Scene, place: tuple[float, float, float], rays: int = 4096) -> NDArray[np.float64]:
    """Return the light that arrives at level ground after one and after two reflections, (3,), without the engine's code."""
    triangles, random = triangles_of(scene), np.random.default_rng(7)
    albedo = np.array([GREY] * 12 + [GREY] * 12 + [RED] * 12 + [GREY] * 24)

    def gathered(
        points: NDArray[np.float64], normals: NDArray[np.float64], count: int, depth: int
    ) -> NDArray[np.float64]:
        # Cosine-weighted directions: a point of the unit sphere, moved by the normal.
        sphere = random.normal(size=(len(points), count, 3))
        sphere /= np.linalg.norm(sphere, axis=2, keepdims=True)
        toward = (sphere + 0.999 * normals[:, None]).reshape(-1, 3)
        toward /= np.linalg.norm(toward, axis=1, keepdims=True)
        origins = np.repeat(points + 1e-3 * normals, count, axis=0)
        radiance = np.zeros((len(origins), 3))
        hit = triangles.intersector.intersects_first(origins, toward)
        seen = hit >= 0
        corners = triangles.intersector.mesh.triangles[hit[seen]]
        facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        facing /= np.linalg.norm(facing, axis=1, keepdims=True)
        along = ((corners[:, 0] - origins[seen]) * facing).sum(axis=1) / (toward[seen] * facing).sum(axis=1)
        met = origins[seen] + toward[seen] * along[:, None]
        light = sunlight(scene, triangles, met + 1e-3 * facing, facing)
        if depth > 1:
            light += gathered(met, facing, 1, depth - 1)
        radiance[seen] = albedo[hit[seen]] * light
        return radiance.reshape(len(points), count, 3).mean(axis=1)

    return gathered(np.array([place]), np.array([[0.0, 0.0, 1.0]]), rays, 2)[0]


def sunlight(
    scene: Scene, triangles: Triangles, points: NDArray[np.float64], normals: NDArray[np.float64]
) -> NDArray[np.float64]:
    cosine = np.maximum(normals @ scene.sun_direction(), 0)
    return (cosine * ~blocked(triangles, points, scene.sun_direction()))[:, None] * sky_of(scene).sun


@pytest.mark.gl
@pytest.mark.parametrize(("camera", "y"), [("camera-1", 0.0), ("camera-2", 60.0)])
def test_shade_has_the_light_of_the_wall_before_it_and_not_of_one_far_away(
    raster: RasterRenderer, camera: str, y: float
) -> None:
    scene = street()
    pixels = raster.full(scene, View(camera, 64, 64)).pixels.astype(np.float64)
    shown = pixels[28:36, 28:36].mean(axis=(0, 1)) / GREY
    expected = arriving(scene, (2.0, y, 0.0))
    # With the mean of the whole scene, which is half red, these ratios are 0.75, 2.45 and 2.45 before the red wall, and 1.29,
    # 0.62 and 0.62 before the grey one.
    ratios = shown / expected
    assert ratios.max() < FACTOR
    assert ratios.min() > 1 / FACTOR


class TestNearby:
    """Places on a wall at x = 5 that faces −x, and on the ground below."""

    def sample(self) -> SurfaceSample:
        y, z = (part.ravel() for part in np.meshgrid(np.arange(-20.0, 21.0), np.arange(0.5, 10.0)))
        x, along = (part.ravel() for part in np.meshgrid(np.arange(-20.0, 5.0), np.arange(-20.0, 21.0)))
        wall, ground = np.column_stack([np.full(len(y), 5.0), y, z]), np.column_stack([x, along, np.zeros(len(x))])
        normals = np.concatenate(
            [np.broadcast_to([-1.0, 0, 0], wall.shape), np.broadcast_to([0, 0, 1.0], ground.shape)]
        )
        return SurfaceSample(np.concatenate([wall, ground]), normals, np.zeros(len(normals), np.intp), 0.0, 1.0)

    def light(self, sample: SurfaceSample, wall: float, ground: float, mean: float) -> Reflected:
        radiance = np.where(sample.normals[:, :1] < 0, wall, ground) * np.ones((1, 3))
        return Reflected(np.full((32, 3), mean), np.full(3, mean), np.full(3, mean), radiance)

    def test_it_is_nothing_where_all_surfaces_have_the_mean_radiance(self) -> None:
        sample = self.sample()
        box = np.array([[-20.0, -20, 0], [5, 20, 10]])
        near = nearby(sample, np.ones(len(sample.points)), self.light(sample, 1.0, 1.0, 1.0), DIRECTIONS, box)
        np.testing.assert_allclose(near.table, 0, atol=1e-6)

    def test_toward_a_bright_wall_it_is_bright_and_below_it_is_the_ground(self) -> None:
        sample = self.sample()
        box = np.array([[-3.0, -4, 0], [5, 4, 2]])  # one cell is 6 m high
        near = nearby(sample, np.ones(len(sample.points)), self.light(sample, 2.0, 0.25, 1.0), DIRECTIONS, box)
        assert near.table.shape == (4, 1, 1, 1, 4)
        mean, x, *_ = near.table[0, 0, 0, 0]
        # In the direction of the wall, and in no other, the surfaces above a place are known, and twice as bright as the mean.
        assert mean + x == pytest.approx(1.0, rel=0.1)
        assert mean - x < 0.5
        # A fifth of the light from below is of the wall's lower part.
        assert -0.75 < near.table[3, 0, 0, 0, 0] < -0.3

    def test_no_direction_is_darker_than_black(self) -> None:
        sample = self.sample()
        box = np.array([[-20.0, -20, 0], [5, 20, 10]])
        light = self.light(sample, 0.0, 0.0, 1.0)
        near = nearby(sample, np.ones(len(sample.points)), light, DIRECTIONS, box)
        linear = np.column_stack([np.ones(32), DIRECTIONS])
        assert (light.hidden.min() + near.table[:3] @ linear.T).min() >= -1e-6

    def test_a_scene_of_any_size_has_few_cells(self) -> None:
        sample = self.sample()
        box = np.array([[-500.0, -800, 0], [500, 800, 60]])
        near = nearby(sample, np.ones(len(sample.points)), self.light(sample, 2.0, 0.5, 1.0), DIRECTIONS, box)
        assert near.table.size <= 2 * 512 * 16
