"""The contract of all engines for Cycles, and properties of a path tracer: noise, seeds, a denoiser."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from valerie.errors import RenderingError
from valerie.rendering.base import Rectangle, Renderer, View
from valerie.rendering.cycles import translation
from valerie.rendering.cycles.blender import BlenderHolder
from valerie.rendering.cycles.reach import denoised_window, reached_rectangle
from valerie.rendering.cycles.renderer import CyclesRenderer
from valerie.rendering.cycles.settings import CyclesSettings
from valerie.scene.variation.variant import apply
from valerie.testing.assets import simple_asset
from valerie.testing.rendering import POSES, RendererContract, assert_same, assert_within_noise

VIEW = View("camera-1", 160, 90)


def engine(holder: BlenderHolder, **settings: object) -> CyclesRenderer:
    return CyclesRenderer(CyclesSettings.model_validate({"samples": 4, "denoise": False, **settings}), holder)


class TestCycles(RendererContract):
    noisy = True

    @pytest.fixture
    def renderer(self, holder: BlenderHolder) -> Renderer:  # type: ignore[override]
        return engine(holder)

    @pytest.fixture
    def other_noise(self, holder: BlenderHolder) -> Renderer:
        return engine(holder, seed=1)


@pytest.mark.parametrize("pose", POSES[:2])
def test_without_denoiser_a_layer_is_the_part_of_the_frame_bit_for_bit(holder: BlenderHolder, pose: dict) -> None:
    scene = apply(pose, simple_asset())
    layer, full = engine(holder).layer(scene, VIEW), engine(holder).full(scene, VIEW)
    np.testing.assert_array_equal(layer.pixels, full.pixels[layer.rectangle.slices])


def test_with_denoiser_a_layer_is_the_part_of_the_frame_within_the_noise(holder: BlenderHolder) -> None:
    scene = apply(POSES[1], simple_asset())
    first, other = engine(holder, samples=8, denoise=True), engine(holder, samples=8, denoise=True, seed=1)
    layer = first.layer(scene, VIEW)
    joined = layer.over(first.background(scene, VIEW))
    assert_within_noise(joined, first.full(scene, VIEW), other.full(scene, VIEW), layer.rectangle)


@pytest.mark.parametrize(
    ("view", "border"),
    [
        (VIEW, Rectangle(53, 31, 40, 37)),
        (VIEW, Rectangle(0, 80, 160, 10)),
        # In single precision 28/270 of 270 pixels are less than 28, and the other edges round down likewise.
        (View("camera-1", 270, 54), Rectangle(28, 7, 190, 46)),
        (View("camera-1", 270, 54), Rectangle(20, 7, 36, 22)),
        (View("camera-1", 270, 54), Rectangle(28, 25, 28, 29)),
    ],
)
def test_a_border_shows_the_pixels_of_the_whole_image_bit_for_bit(
    holder: BlenderHolder, view: View, border: Rectangle
) -> None:
    scene, settings = apply(POSES[1], simple_asset()), CyclesSettings(samples=4).inputs()
    whole = translation.guided(holder.get(), scene, view, settings)
    part = translation.guided(holder.get(), scene, view, settings, border=border)
    for name, pixels in part._asdict().items():
        np.testing.assert_array_equal(pixels, getattr(whole, name)[border.slices], err_msg=name)


def test_guides_do_not_change_the_image(holder: BlenderHolder) -> None:
    scene, settings = apply(POSES[1], simple_asset()), CyclesSettings(samples=4, denoise=False).inputs()
    plain = translation.render(holder.get(), scene, VIEW, settings)
    np.testing.assert_array_equal(translation.guided(holder.get(), scene, VIEW, settings).noisy, plain)
    np.testing.assert_array_equal(translation.render(holder.get(), scene, VIEW, settings), plain)


def test_denoising_afterwards_gives_the_image_of_denoising_at_once(holder: BlenderHolder) -> None:
    scene, settings = apply(POSES[1], simple_asset()), CyclesSettings(samples=4).inputs()
    at_once = translation.render(holder.get(), scene, VIEW, settings)
    inputs = translation.guided(holder.get(), scene, VIEW, settings)
    tolerance = 1e-4
    np.testing.assert_allclose(translation.denoised(holder.get(), inputs), at_once, atol=tolerance)
    assert np.abs(inputs.noisy - at_once).max() > 500 * tolerance


def test_the_denoiser_pools_the_pixels_of_a_window_like_those_of_the_whole_image(
    holder: BlenderHolder,
) -> None:
    scene, view = apply(POSES[0], simple_asset()), View("camera-1", 320, 180)
    inputs = translation.guided(holder.get(), scene, view, CyclesSettings(samples=8).inputs())
    whole, rectangle = translation.denoised(holder.get(), inputs), reached_rectangle(scene, view)

    def error(window: Rectangle) -> float:
        part = translation.Guided(*(np.ascontiguousarray(layer[window.slices]) for layer in inputs))
        image = np.zeros_like(whole)
        image[window.slices] = translation.denoised(holder.get(), part)
        return float(np.sqrt(((image - whole)[rectangle.slices] ** 2).mean()))

    aligned = denoised_window(rectangle, view)
    assert not aligned.empty
    # This window has a margin at least as wide as `aligned`, but its edges are not on the blocks of the whole image.
    shifted = Rectangle(aligned.x - 4, aligned.y - 4, aligned.width + 8, aligned.height + 8).clipped(320, 180)
    # By a quarter, a requirement of ours.
    assert error(aligned) < 0.75 * error(shifted)


def test_a_denoised_image_has_the_same_bytes_every_time(holder: BlenderHolder) -> None:
    cycles = engine(holder, denoise=True)
    scene = simple_asset().base
    first = cycles.full(scene, VIEW)
    engine(holder).background(scene, View("camera-2", 64, 40))
    assert_same(cycles.full(scene, VIEW), first)


def test_another_number_of_threads_gives_the_same_bytes(holder: BlenderHolder, deployment) -> None:
    scene = simple_asset().base
    alone = BlenderHolder(deployment.model_copy(update={"cycles_threads": 1}))
    try:
        single = engine(alone, denoise=True).background(scene, VIEW)
    finally:
        alone.close()
    assert_same(single, engine(holder, denoise=True).background(scene, VIEW))


def test_more_samples_and_the_denoiser_each_bring_the_image_nearer_to_the_reference(holder: BlenderHolder) -> None:
    scene, view = simple_asset().base, View("camera-1", 96, 54)
    reference = engine(holder, samples=512, seed=9).background(scene, view).pixels.astype(np.float64)

    def error(**settings: object) -> float:
        pixels = engine(holder, **settings).background(scene, view).pixels
        return float(np.sqrt(((pixels.astype(np.float64) - reference) ** 2).mean()))

    few, many, cleaned = error(samples=4), error(samples=64), error(samples=4, denoise=True)
    # 16 times as many samples have a quarter of the error, and the reference has some. The denoiser's half is a requirement.
    assert many < few / 2
    assert cleaned < few / 2


def test_a_seed_changes_the_noise_and_nothing_else(holder: BlenderHolder) -> None:
    scene = simple_asset().base
    first, second = (engine(holder, samples=32, seed=seed).background(scene, VIEW).pixels for seed in (0, 1))
    assert (first != second).any()
    means = [pixels[60:].astype(np.float64).mean() for pixels in (first, second)]
    # Four standard errors of the difference of two means. The standard deviation of one sample is at most its mean.
    assert abs(means[0] / means[1] - 1) < 4 * math.sqrt(2 / (32 * first[60:, :, 0].size))


def test_settings_of_the_previous_image_leave_no_trace(holder: BlenderHolder) -> None:
    scene = simple_asset().base
    first = engine(holder).background(scene, VIEW)
    before: tuple[dict[str, object], ...] = (
        {"samples": 16},
        {"seed": 3},
        {"denoise": True},
        {"max_bounces": 1},
        {"light_tree": False},
    )
    for settings in before:
        engine(holder, **settings).background(scene, View("camera-2", 48, 27))
        assert_same(engine(holder).background(scene, VIEW), first)
    translation.object_index(holder.get(), scene, VIEW, CyclesSettings(samples=4, denoise=False).inputs())
    assert_same(engine(holder).background(scene, VIEW), first)


def test_earlier_images_leave_no_trace(holder: BlenderHolder) -> None:
    cycles, asset = engine(holder), simple_asset()
    first = cycles.full(asset.base, VIEW)
    with pytest.raises(RenderingError):
        cycles.background(apply({"scene.sun-1.irradiance": 0.0}, asset), VIEW)
    cycles.layer(apply({"scene.person-1.character": "blue-coat", "scene.person-2.character": "red-coat"}, asset), VIEW)
    few = replace(asset.base, nodes={path: node for path, node in asset.base.nodes.items() if "car" not in path})
    cycles.background(few, VIEW)
    layer = cycles.layer(asset.base, VIEW)
    np.testing.assert_array_equal(layer.pixels, first.pixels[layer.rectangle.slices])
