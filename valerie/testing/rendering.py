"""Contract of render engines: subclass `RendererContract`, override its fixture ``renderer``, and run it with pytest."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import ndimage

from valerie.errors import RenderingError, UnknownName
from valerie.labels import PERSON, SKY, instance_id
from valerie.rendering.base import GroundTruth, LinearImage, Rectangle, Renderer, View
from valerie.scene.assets.asset import SceneAsset
from valerie.scene.graph.model import Camera, Environment, Scene, Sun, Texture
from valerie.scene.graph.transforms import camera_transform
from valerie.scene.variation.variant import apply
from valerie.testing.assets import simple_asset

#: Assignments of `simple_asset`: movables stand free, are hidden, overlap, cross the image's border, are several, or out of view.
POSES: tuple[Mapping[str, float | str], ...] = (
    {},
    {"scene.person-1.pos.x": 2.0, "scene.person-1.pos.y": 12.0, "scene.person-1.heading": 30.0},
    {"scene.person-1.pos.x": 4.6, "scene.person-1.pos.y": 8.0, "scene.sun-1.elevation": 10.0},
    {"scene.person-1.pos.y": 0.5, "scene.sun-1.azimuth": 300.0},
    {"scene.person-2.character": "blue-coat", "scene.person-2.pos.x": -2.5, "scene.person-2.pos.y": 14.0},
    {"scene.person-1.pos.x": 14.0, "scene.person-1.pos.y": 3.0},
)
#: Assignments of `simple_asset` in which `from_below` sees ``person-1`` against the sky: free, behind the car, across the border.
BEFORE_THE_SKY: tuple[Mapping[str, float | str], ...] = (
    {"scene.person-1.pos.x": -0.6, "scene.person-1.pos.y": 6.0, "scene.person-1.heading": 33.0},
    {"scene.person-1.pos.x": 1.15, "scene.person-1.pos.y": 12.0},
    {"scene.person-1.pos.x": 3.05, "scene.person-1.pos.y": 4.0},
)
#: The view for `from_below`.
BELOW = View("camera-1", 301, 170)
_PERSON_1 = instance_id(PERSON, 1)
#: Smallest number of pixels that a test must compare.
_FEWEST = 50
#: Smallest change of log(1 + 10 v) that counts. A person against the sky changes four times as much, and filters beside it a
#: hundredth.
_VISIBLE = 0.1


class RendererContract:
    """Tests of an engine. The name of a subclass starts with ``Test``, so that pytest collects it.

    Attributes:
        noisy: False if a layer over its background must equal the frame bit for bit. True for an engine that samples light at
            random (a path tracer): inside the rectangle and around it, the two then differ no more than frames of different
            seeds, and a subclass must override ``other_noise`` too. All other tests are the same for both kinds.
    """

    noisy: ClassVar[bool] = False

    @pytest.fixture
    def renderer(self) -> Iterator[Renderer]:
        """Return the engine under test. The subclass must override this."""
        raise NotImplementedError("override the fixture 'renderer' in the subclass")

    @pytest.fixture
    def other_noise(self) -> Renderer:
        """Return the engine with another seed, if it is noisy."""
        raise NotImplementedError("override the fixture 'other_noise' in the subclass of a noisy engine")

    @pytest.fixture
    def asset(self) -> SceneAsset:
        """Return an asset of boxes on a plane, two of them movable."""
        return simple_asset()

    @pytest.fixture
    def view(self) -> View:
        """Return a view of a small image whose sides are not multiples of high powers of two."""
        return View("camera-1", 150, 86)

    def test_an_image_is_linear_half_floats_of_the_asked_size_and_read_only(
        self, renderer: Renderer, asset: SceneAsset, view: View
    ) -> None:
        pixels = renderer.full(asset.base, view).pixels
        assert pixels.shape == (view.height, view.width, 3)
        assert pixels.dtype == np.float16
        assert not pixels.flags.writeable
        assert np.isfinite(pixels).all()
        assert (pixels >= 0).all()

    @pytest.mark.parametrize("pose", POSES)
    def test_the_layer_over_the_background_is_the_frame(
        self,
        renderer: Renderer,
        asset: SceneAsset,
        view: View,
        pose: Mapping[str, float | str],
        request: pytest.FixtureRequest,
    ) -> None:
        scene = apply(pose, asset)
        background, layer = renderer.background(scene, view), renderer.layer(scene, view)
        joined, full = layer.over(background), renderer.full(scene, view)
        if self.noisy:
            other: Renderer = request.getfixturevalue("other_noise")
            assert_within_noise(joined, full, other.full(scene, view), layer.rectangle)
        else:
            assert_same(joined, full)

    def test_equal_scenes_give_equal_bytes_whatever_was_rendered_between(
        self, renderer: Renderer, asset: SceneAsset, view: View
    ) -> None:
        first = renderer.full(apply({}, asset), view)
        layer = renderer.layer(apply({}, asset), view)
        for pose in POSES[1:3]:
            renderer.layer(apply(pose, asset), view)
        renderer.background(apply({}, asset), View("camera-2", 64, 40))
        assert_same(renderer.full(apply({}, asset), view), first)
        again = renderer.layer(apply({}, asset), view)
        assert again.rectangle == layer.rectangle
        np.testing.assert_array_equal(again.pixels, layer.pixels)

    def test_the_background_depends_on_nothing_movable(self, renderer: Renderer, asset: SceneAsset, view: View) -> None:
        first = renderer.background(apply({}, asset), view)
        moved = apply({"scene.person-1.pos.x": 3.3, "scene.person-2.character": "red-coat"}, asset)
        assert_same(renderer.background(moved, view), first)

    def test_a_person_changes_pixels_inside_the_layer(self, renderer: Renderer, asset: SceneAsset, view: View) -> None:
        scene = apply({}, asset)
        layer = renderer.layer(scene, view)
        before = renderer.background(scene, view).pixels[layer.rectangle.slices]
        assert not layer.rectangle.empty
        assert (layer.pixels != before).any(axis=2).sum() > 100

    @pytest.mark.parametrize("pose", BEFORE_THE_SKY)
    def test_a_person_changes_the_pixels_that_the_truth_says_are_its_own(
        self, renderer: Renderer, asset: SceneAsset, pose: Mapping[str, float | str]
    ) -> None:
        scene = from_below(apply(pose, asset))
        background, full = renderer.background(scene, BELOW), renderer.full(scene, BELOW)
        assert_in_step(background, full, *truths(scene, BELOW), noisy=self.noisy)

    def test_without_movables_the_layer_is_empty(self, renderer: Renderer, asset: SceneAsset, view: View) -> None:
        scene = apply({"scene.person-1.character": "absent"}, asset)
        layer = renderer.layer(scene, view)
        assert layer.rectangle.empty
        background = renderer.background(scene, view)
        assert layer.over(background) is background
        assert_same(background, renderer.full(scene, view))

    def test_more_sun_is_brighter(self, renderer: Renderer, asset: SceneAsset, view: View) -> None:
        dim, bright = (
            renderer.background(apply({"scene.sun-1.irradiance": irradiance}, asset), view).pixels.astype(np.float64)
            for irradiance in (0.25, 0.5)
        )
        assert 1.8 < bright.mean() / dim.mean() < 2.2

    def test_a_roughness_map_is_multiplied_with_roughness_and_metallic(
        self, renderer: Renderer, asset: SceneAsset, view: View
    ) -> None:
        plain = asset.base.materials["paving"]
        texels = np.empty((16, 16, 3), np.uint8)
        texels[:] = (255, 102, 204)
        textures = {**asset.base.textures, "map": Texture("map", texels)}

        def full(**changes: Any) -> NDArray[np.float64]:
            materials = {**asset.base.materials, "paving": replace(plain, **changes)}
            scene = replace(asset.base, materials=materials, textures=textures)
            return renderer.full(scene, view).pixels.astype(np.float64)

        mapped = full(roughness=0.75, metallic=0.5, roughness_texture="map")
        np.testing.assert_allclose(mapped, full(roughness=0.3, metallic=0.4), rtol=2e-3, atol=2e-3)
        assert abs(mapped - full(roughness=0.75, metallic=0.4)).max() > 0.01
        assert abs(mapped - full(roughness=0.3, metallic=0.5)).max() > 0.01

    def test_an_unknown_camera_is_named(self, renderer: Renderer, asset: SceneAsset) -> None:
        with pytest.raises(UnknownName, match="camera-9"):
            renderer.background(asset.base, View("camera-9", 64, 64))

    def test_a_black_image_is_an_error(self, renderer: Renderer, view: View) -> None:
        camera = Camera("scene.camera-1", np.eye(4), focal_length_mm=35.0)
        dark = Scene({}, {}, {}, {"camera-1": camera}, Sun(0.0, 0.5, irradiance=0.0), Environment())
        with pytest.raises(RenderingError, match=r"constant|cannot show the night"):
            renderer.background(dark, view)

    def test_a_missing_material_is_named(self, renderer: Renderer, asset: SceneAsset, view: View) -> None:
        broken = replace(asset.base, materials={})
        with pytest.raises(RenderingError, match="no material"):
            renderer.background(broken, view)

    def test_the_numeric_class_can_stand_in_a_queue_name(self, renderer: Renderer) -> None:
        assert re.fullmatch(r"[a-z0-9][a-z0-9.-]{3,}", renderer.numeric_class)


def from_below(scene: Scene) -> Scene:
    """Return the scene with ``camera-1`` near the ground and tilted slightly up, so that most of a person is against the sky."""
    camera = replace(scene.cameras["camera-1"], transform=camera_transform((0.0, -2.0, 0.3), 0.0, 5.0, 0.0))
    return replace(scene, cameras={**scene.cameras, "camera-1": camera})


def truths(scene: Scene, view: View) -> tuple[GroundTruth, GroundTruth]:
    """Return the truth of a scene without its movables, and with them."""
    from valerie.rendering.ground_truth import TruthPass

    truth_pass = TruthPass()
    try:
        statics, layer = truth_pass.parts(scene, view)
        return statics, layer.over(statics)
    finally:
        truth_pass.close()


def assert_in_step(
    background: LinearImage, full: LinearImage, statics: GroundTruth, truth: GroundTruth, *, noisy: bool = False
) -> None:
    """Fail unless the pixels that ``person-1`` changes are those that the truth assigns to it, up to a pixel at its silhouette.

    Each of its pixels must change, except those at its silhouette. Its shadow and the light that it reflects change further
    pixels, but none of the sky: there, away from other silhouettes, no pixel changes farther than a pixel from the person.

    Args:
        background, full: the image without and with movables; ``person-1`` is the only visible one.
        statics, truth: the truth without and with movables.
        noisy: True to judge only pixels against the sky, and to allow changes two pixels around the person, since samples may be
            off by the radius of the engine's pixel filter.
    """
    before, after = (np.log1p(10 * image.pixels.astype(np.float64)) for image in (background, full))
    # Filters reach farther than half a pixel, but by less than this.
    changed = abs(after - before).max(axis=2) > _VISIBLE
    person = truth.instance_map == _PERSON_1
    sky = _shrunk(statics.class_map == SKY.id)
    own = _shrunk(person) & (sky if noisy else True)
    assert (own & sky).sum() >= _FEWEST, "too little of the person is visible against the sky"
    assert not (own & ~changed).any(), f"{(own & ~changed).sum()} pixels of the person do not change"
    others = _shrunk(~person)
    others = sky & (_shrunk(others) if noisy else others)
    assert not (others & changed).any(), f"{(others & changed).sum()} pixels of the sky change beside the person"


def _shrunk(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the pixels of the mask, (H, W) bool, whose eight neighbours inside the image are all in the mask."""
    shrunk: NDArray[np.bool_] = ndimage.binary_erosion(mask, np.ones((3, 3), np.bool_), border_value=1)
    return shrunk


def assert_within_noise(joined: LinearImage, full: LinearImage, reseeded: LinearImage, changed: Rectangle) -> None:
    """Fail if two images differ more than two seeds do, in the rectangle, in the ring around it, or in the whole image."""
    height, width = full.pixels.shape[:2]
    ring = 8
    around = Rectangle(changed.x - ring, changed.y - ring, changed.width + 2 * ring, changed.height + 2 * ring)
    for place in (changed, around.clipped(width, height), Rectangle(0, 0, width, height)):
        if not place.empty:
            noise = _rms(full, reseeded, place)
            assert _rms(joined, full, place) <= noise, f"{place}: more than the noise ({noise:.4g})"


def _rms(first: LinearImage, second: LinearImage, place: Rectangle) -> float:
    """Return the root mean square difference after log(1 + 10 v), a curve that weighs dark and bright alike."""
    curves: list[NDArray[np.float64]] = [
        np.log1p(10 * image.pixels[place.slices].astype(np.float64)) for image in (first, second)
    ]
    return float(np.sqrt(((curves[0] - curves[1]) ** 2).mean()))


def assert_same(first: LinearImage, second: LinearImage) -> None:
    """Fail unless two images are equal bit for bit."""
    np.testing.assert_array_equal(first.pixels.view(np.uint16), second.pixels.view(np.uint16))
