"""The mean reflectance of materials against values computed by hand."""

from dataclasses import replace
from typing import cast

import moderngl
import numpy as np
import pytest
from numpy.typing import NDArray

from valerie.rendering.raster.upload.materials import mean_reflectance
from valerie.rendering.raster.upload.textures import TextureSet
from valerie.scene.graph.model import Material, Texture

PLASTER = Material("plaster", (0.8, 0.5, 0.2))
#: Linear value of the byte 188 by the sRGB formula: nearly half of white.
HALF = ((188 / 255 + 0.055) / 1.055) ** 2.4


def reflectance(material: Material, **textures: NDArray[np.uint8]) -> tuple[NDArray[np.float64], float]:
    # Means are computed from the images and need no GPU.
    texture_set = TextureSet(
        cast("moderngl.Context", None), {name: Texture(name, image) for name, image in textures.items()}
    )
    albedo, share = mean_reflectance([material], texture_set)
    return albedo[0], float(share[0])


def test_without_textures_it_is_the_base_color() -> None:
    albedo, share = reflectance(PLASTER)
    assert (tuple(albedo), share) == (PLASTER.base_color, 1.0)


def test_metal_has_no_diffuse_albedo() -> None:
    albedo, _ = reflectance(replace(PLASTER, metallic=0.75))
    assert albedo == pytest.approx(np.array(PLASTER.base_color) * 0.25)


def test_the_blue_of_a_roughness_texture_is_the_metallic_factor() -> None:
    blue = np.full((35, 35, 3), 255, np.uint8)
    blue[..., 2] = 102
    albedo, _ = reflectance(replace(PLASTER, metallic=0.5, roughness_texture="map"), map=blue)
    assert albedo == pytest.approx(np.array(PLASTER.base_color) * 0.8)


def test_a_colour_texture_is_averaged_in_linear_light() -> None:
    # Half white, half a grey of linear 0.503. The mean of the bytes would be a different grey.
    image = np.full((70, 70, 3), 255, np.uint8)
    image[:35] = 188
    albedo, share = reflectance(replace(PLASTER, base_color_texture="wall"), wall=image)
    assert albedo == pytest.approx(np.array(PLASTER.base_color) * (1 + HALF) / 2)
    assert share == 1.0


@pytest.mark.parametrize(("cutoff", "share"), [(0.5, 0.5), (None, 1.0)])
def test_cut_texels_have_no_colour_and_no_share(cutoff: float | None, share: float) -> None:
    image = np.full((70, 70, 4), 255, np.uint8)
    image[:35] = (188, 188, 188, 100)
    leaf = replace(PLASTER, base_color_texture="leaf", alpha_cutoff=cutoff)
    albedo, area = reflectance(leaf, leaf=image)
    assert area == share
    assert albedo == pytest.approx(np.array(PLASTER.base_color) * (1.0 if cutoff else (1 + HALF) / 2))


def test_a_texture_that_is_cut_out_completely_reflects_nothing() -> None:
    leaf = replace(PLASTER, base_color_texture="leaf", alpha_cutoff=0.5)
    albedo, share = reflectance(leaf, leaf=np.zeros((35, 35, 4), np.uint8))
    assert (tuple(albedo), share) == ((0.0, 0.0, 0.0), 0.0)
