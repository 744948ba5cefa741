"""Light on persons and their contrast against scenes with a known answer."""

from collections.abc import Sequence
from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from valerie.rendering.base import GroundTruth, LinearImage, PersonTruth, Rectangle, View
from valerie.rendering.ground_truth import TruthPass
from valerie.rendering.person_light import PersonLight, Received, measure_light, ring_contrast, ring_width
from valerie.rendering.raster import renderer
from valerie.rendering.raster.renderer import RasterRenderer
from valerie.rendering.sky import AZIMUTHS, ELEVATIONS, EXPOSURE, sky_of
from valerie.scene.graph.model import Node, Scene
from valerie.scene.variation.variant import apply
from valerie.testing.assets import box_mesh, simple_asset

VIEW = View("camera-1", 320, 180)
PERSON = 24001


class TestContrast:
    def test_it_is_the_michelson_contrast_of_body_and_ring(self) -> None:
        luminance, mask, box = square(body=0.2, around=0.6)
        assert ring_contrast(luminance, mask, box) == pytest.approx((0.2 - 0.6) / (0.2 + 0.6))

    def test_it_is_positive_for_a_brighter_body(self) -> None:
        luminance, mask, box = square(body=0.9, around=0.1)
        assert ring_contrast(luminance, mask, box) == pytest.approx(0.8)

    def test_pixels_beyond_the_ring_or_at_the_edge_do_not_count(self) -> None:
        luminance, mask, box = square(body=0.2, around=0.6)
        width = ring_width(int(mask.sum()))
        assert width == 2  # a fifth of the root of 100 pixels
        rows, columns = np.indices(mask.shape)
        # Distance from the square's edge in pixels: 1 is the mixed border, 2 and 3 are the ring.
        away = np.maximum(np.maximum(20 - columns, columns - 29), np.maximum(15 - rows, rows - 24))
        luminance[(away == 1) | (away > 3)] = 100.0
        assert ring_contrast(luminance, mask, box) == pytest.approx(-0.5)

    def test_the_ring_grows_with_the_body(self) -> None:
        assert [ring_width(n) for n in (1, 100, 400, 10_000)] == [2, 2, 4, 20]

    def test_at_the_border_of_the_image_the_ring_is_cut_off(self) -> None:
        luminance = np.full((20, 30), 0.6, np.float32)
        mask = np.zeros((20, 30), np.bool_)
        mask[:10, :8] = True
        luminance[mask] = 0.2
        # Ring and gap reach 3 pixels on two sides, and the gap reaches 1: 13 × 11 pixels minus 11 × 9.
        luminance[5, 9] += 4.4  # one of the ring's 44
        outer = 0.6 + 4.4 / 44
        assert ring_contrast(luminance, mask, Rectangle(0, 0, 8, 10)) == pytest.approx((0.2 - outer) / (0.2 + outer))

    def test_it_is_undefined_without_a_ring_or_without_light(self) -> None:
        whole = np.ones((4, 4), np.bool_)
        assert ring_contrast(np.ones((4, 4), np.float32), whole, Rectangle(0, 0, 4, 4)) is None
        luminance, mask, box = square(body=0.0, around=0.0)
        assert ring_contrast(luminance, mask, box) is None


def square(*, body: float, around: float) -> tuple[NDArray[np.float32], NDArray[np.bool_], Rectangle]:
    luminance = np.full((40, 50), around, np.float32)
    mask = np.zeros((40, 50), np.bool_)
    mask[15:25, 20:30] = True
    luminance[mask] = body
    return luminance, mask, Rectangle(20, 15, 10, 10)


class FixedLight:
    """A light pass that returns fixed samples."""

    def __init__(self, samples: NDArray[np.float32], *, sunny: bool = True) -> None:
        self._samples, self._sunny = samples, sunny

    def received(self, scene: Scene, view: View, rectangles: Sequence[Rectangle]) -> list[Received]:
        return [Received(box, self._samples[box.slices], 2.0, self._sunny) for box in rectangles]


class TestMeans:
    def test_they_are_over_the_visible_pixels_whose_depth_agrees(self) -> None:
        samples = np.zeros((36, 64, 4), np.float32)
        samples[...] = (9.0, 9.0, 1.0, 30.0)  # something else, further away
        samples[10:20, 20:25] = (1.0, 0.2, 1.0, 10.0)
        samples[10:20, 25:30] = (0.0, 0.2, 0.2, 10.0)
        samples[10:13, 20:30, 3] = 30.0  # an edge: the sample missed the body
        (person,) = measure_light(truth(), grey(), simple_asset().base, VIEW, FixedLight(samples))
        assert person.irradiance == pytest.approx((1.2 + 0.2) / 2 / 2.0)
        assert person.shadow_share == pytest.approx(0.5)

    def test_without_a_sun_there_is_no_share_in_its_shadow(self) -> None:
        samples = np.full((36, 64, 4), (0.0, 0.2, 0.0, 10.0), np.float32)
        (person,) = measure_light(truth(), grey(), simple_asset().base, VIEW, FixedLight(samples, sunny=False))
        assert person.shadow_share is None
        assert person.irradiance == pytest.approx(0.1)

    def test_a_person_without_a_visible_pixel_has_no_values(self) -> None:
        unseen = replace(truth(), instance_map=np.zeros((36, 64), np.uint16))
        nobody = FixedLight(np.zeros((36, 64, 4), np.float32))
        assert measure_light(unseen, grey(), simple_asset().base, VIEW, nobody) == (
            PersonLight(PERSON, None, None, None),
        )


def truth() -> GroundTruth:
    instances = np.zeros((36, 64), np.uint16)
    instances[10:20, 20:30] = PERSON
    depth = np.full((36, 64), 10.0, np.float32)
    persons = (PersonTruth.of(PERSON, instances > 0, 100),)
    return GroundTruth(np.where(instances > 0, 24, 7).astype(np.uint8), instances, depth, persons)


def grey() -> LinearImage:
    return LinearImage(np.full((36, 64, 3), 0.4, np.float16))


@pytest.mark.gl
class TestLightOfTheRasterEngine:
    @pytest.mark.parametrize("elevation", [20.0, 45.0, 60.0])
    def test_sunlight_on_a_surface_is_the_cosine_of_the_suns_angle(
        self, raster: RasterRenderer, truth_pass: TruthPass, elevation: float
    ) -> None:
        # The person faces the camera, towards −y, and the sun stands in the south behind the camera.
        scene = lit(azimuth=180.0, elevation=elevation)
        samples = on_the_body(raster, truth_pass, scene)
        assert np.median(samples[:, 0]) == pytest.approx(np.cos(np.deg2rad(elevation)), rel=0.01)
        # At its outline a body may shade itself: a tenth of its pixels, a requirement of ours.
        assert (samples[:, 2] == 1.0).mean() > 0.9

    @pytest.mark.parametrize("movable", [False, True])
    @pytest.mark.parametrize("shaded", [0.3, 0.9, 1.2])
    def test_the_shadow_share_is_that_of_a_wall_that_shades_the_body_up_to_a_height(
        self, raster: RasterRenderer, truth_pass: TruthPass, shaded: float, movable: bool
    ) -> None:
        # The wall stands behind the camera, 12.8 m from the body's front. With the sun straight behind both, 20° high, the
        # shadow of the wall's upper edge reaches the height `shaded` on the body.
        height = shaded + 12.8 * np.tan(np.deg2rad(20.0))
        scene = with_wall(lit(elevation=20.0), y=-3.0, height=float(height), movable=movable)
        # Seen from the front, the coat is 0.5 m wide and 1.5 m high. The head measures 0.24 × 0.3 m and is 0.08 m farther away.
        head = 0.24 * 0.3 * (11.8 / 11.88) ** 2
        assert light_of(raster, truth_pass, scene).shadow_share == pytest.approx(
            0.5 * shaded / (0.5 * 1.5 + head), abs=0.025
        )

    def test_under_an_even_sky_on_black_ground_an_upright_surface_gets_half_the_light_of_the_ground(
        self, truth_pass: TruthPass, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        # The irradiance of level ground under a sky of radiance L is the integral of L cos over the hemisphere, π L. An upright
        # surface sees half of that sky: π L / 2. The table holds π L in the image's unit.
        radiance, scene = np.array([0.6, 0.9, 1.2]), on_ground_of(0.0, in_the_open(lit()))
        even = replace(
            sky_of(scene),
            table=np.broadcast_to(radiance, (ELEVATIONS, AZIMUTHS, 3)).astype(np.float32),
            sky_irradiance=radiance,
            sun=np.zeros(3),
        )
        monkeypatch.setattr(renderer, "sky_of", lambda _: even)
        with closing(RasterRenderer()) as fresh:
            samples = on_the_body(fresh, truth_pass, scene)
        assert (samples[:, 0] == 0.0).all()
        expected = float(radiance @ [0.2126, 0.7152, 0.0722]) / 2 / EXPOSURE
        # The engine samples the sky in 32 directions, of which not exactly half lie in front of a surface.
        assert np.median(samples[:, 1]) == pytest.approx(expected, rel=0.04)

    @pytest.mark.parametrize("albedo", [0.0, 0.2, 0.6])
    def test_an_overcast_sky_lights_an_upright_surface_by_the_formula_of_moon_and_spencer(
        self, raster: RasterRenderer, truth_pass: TruthPass, albedo: float
    ) -> None:
        # The radiance is (1 + 2 sin γ) / 3 of the zenith's. The ground receives 7π/9 of that, and an upright surface π/6 + 4/9,
        # with half of the light that the ground reflects.
        scene = on_ground_of(albedo, in_the_open(lit()))
        scene = replace(scene, environment=replace(scene.environment, cloud_cover=1.0))
        on_ground = float(sky_of(scene).sky_irradiance @ [0.2126, 0.7152, 0.0722])
        expected = on_ground * ((np.pi / 6 + 4 / 9) / (7 * np.pi / 9) + albedo / 2)
        samples = on_the_body(raster, truth_pass, scene)
        assert np.median(samples[:, 1]) == pytest.approx(expected / EXPOSURE, rel=0.03)

    def test_a_white_wall_in_front_of_a_body_lights_it_and_a_black_one_does_not(
        self, raster: RasterRenderer, truth_pass: TruthPass
    ) -> None:
        # The wall stands behind the camera in full sun, and hides the sky from the body.
        def by_wall(albedo: float) -> float:
            scene = with_wall(on_ground_of(0.0, in_the_open(lit(azimuth=0.0))), y=-3.0, height=40.0, movable=False)
            plaster = replace(scene.materials["plaster"], base_color=(albedo,) * 3)
            scene = replace(scene, materials={**scene.materials, "plaster": plaster})
            return float(np.median(on_the_body(raster, truth_pass, scene)[:, 1]))

        white, black = by_wall(0.8), by_wall(0.0)
        # In units of the sun: the wall, 6 × 40 m and 12.8 m from the body's middle, receives cos(45°) and reflects 0.8 of it. It
        # fills twice the share of a rectangle to one side of the middle (Howell's catalogue, B-3). Light of the sky adds to that.
        x, y = 3.0 / 12.8, (40.0 - 0.9) / 12.8
        one_side = (
            x / np.hypot(1, x) * np.arctan(y / np.hypot(1, x)) + y / np.hypot(1, y) * np.arctan(x / np.hypot(1, y))
        ) / (2 * np.pi)
        assert white - black > 0.8 * np.cos(np.deg2rad(45.0)) * 2 * one_side

    def test_light_grows_with_the_suns_irradiance(self, raster: RasterRenderer, truth_pass: TruthPass) -> None:
        dim, bright = (light_of(raster, truth_pass, lit(irradiance=strength)) for strength in (0.5, 1.0))
        assert dim.irradiance is not None
        assert bright.irradiance == pytest.approx(2 * dim.irradiance, rel=1e-3)
        assert bright.shadow_share == dim.shadow_share

    def test_with_the_sun_behind_the_body_lies_in_its_own_shadow(
        self, raster: RasterRenderer, truth_pass: TruthPass
    ) -> None:
        before = light_of(raster, truth_pass, lit(azimuth=180.0))
        behind = light_of(raster, truth_pass, lit(azimuth=0.0))
        # All but a hundredth, pixels of the outline: a requirement of ours.
        assert (before.shadow_share or 0.0) < 0.01
        assert (behind.shadow_share or 0.0) > 0.99
        assert behind.irradiance is not None
        assert before.irradiance is not None
        # The sun gives cos(45°), and the sky is brighter around it.
        assert before.irradiance - behind.irradiance > np.cos(np.deg2rad(45.0))
        assert behind.contrast is not None
        assert before.contrast is not None
        assert behind.contrast < before.contrast

    def test_an_overcast_sky_has_no_shadow_to_share(self, raster: RasterRenderer, truth_pass: TruthPass) -> None:
        scene = lit()
        overcast = replace(scene, environment=replace(scene.environment, cloud_cover=1.0))
        person = light_of(raster, truth_pass, overcast)
        assert person.shadow_share is None
        assert (person.irradiance or 0.0) > 0.0

    def test_the_material_changes_the_contrast_but_not_the_light(
        self, raster: RasterRenderer, truth_pass: TruthPass
    ) -> None:
        red, blue = (light_of(raster, truth_pass, lit(character=coat)) for coat in ("red-coat", "blue-coat"))
        assert (red.irradiance, red.shadow_share) == (blue.irradiance, blue.shadow_share)
        assert red.contrast != blue.contrast

    def test_measuring_leaves_no_trace_in_the_next_image(self, raster: RasterRenderer, truth_pass: TruthPass) -> None:
        scene = lit(azimuth=120.0)
        first = raster.layer(scene, VIEW)
        light_of(raster, truth_pass, lit(azimuth=120.0, x=0.7))
        again = raster.layer(scene, VIEW)
        assert again.rectangle == first.rectangle
        assert again.pixels.tobytes() == first.pixels.tobytes()


def lit(
    *,
    azimuth: float = 180.0,
    elevation: float = 45.0,
    irradiance: float = 1.0,
    character: str = "red-coat",
    x: float = 0.0,
) -> Scene:
    sun = {"azimuth": azimuth, "elevation": elevation, "irradiance": irradiance}
    values = {f"scene.sun-1.{name}": value for name, value in sun.items()}
    return apply({**values, "scene.person-1.character": character, "scene.person-1.pos.x": x}, simple_asset())


def with_wall(scene: Scene, *, y: float, height: float, movable: bool) -> Scene:
    """Return the scene with a wall across at ``y``, 6 m long and 0.2 m thick."""
    wall = box_mesh((-3.0, y - 0.2, 0.0), (3.0, y, height), "plaster")
    node = Node("scene.wall-1", np.eye(4), (wall,), label_id=12, movable=movable)
    return replace(scene, nodes={**scene.nodes, node.path: node})


def in_the_open(scene: Scene) -> Scene:
    """Return the scene without house and car."""
    nodes = {path: node for path, node in scene.nodes.items() if "building" not in path and "car" not in path}
    return replace(scene, nodes=nodes)


def on_ground_of(albedo: float, scene: Scene) -> Scene:
    """Return the scene with grey ground."""
    paving = replace(scene.materials["paving"], base_color=(albedo,) * 3, base_color_texture=None)
    return replace(scene, materials={**scene.materials, "paving": paving})


def light_of(raster: RasterRenderer, truth_pass: TruthPass, scene: Scene) -> PersonLight:
    image = raster.layer(scene, VIEW).over(raster.background(scene, VIEW))
    (person,) = measure_light(truth_pass.truth(scene, VIEW), image, scene, VIEW, raster)
    return person


def on_the_body(raster: RasterRenderer, truth_pass: TruthPass, scene: Scene) -> NDArray[np.float32]:
    """Return the light on the visible pixels of the person, (N, 4), in units of a sun of irradiance 1."""
    mask = truth_pass.truth(scene, VIEW).instance_map == PERSON
    rows, columns = np.nonzero(mask)
    corner = int(columns.min()), int(rows.min())
    box = Rectangle(*corner, int(columns.max()) - corner[0] + 1, int(rows.max()) - corner[1] + 1)
    (received,) = raster.received(scene, VIEW, [box])
    samples = received.samples[mask[box.slices]]
    samples[:, :2] /= received.unit
    return samples
