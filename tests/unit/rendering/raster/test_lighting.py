"""What the lighting passes are given."""

import numpy as np

from valerie.rendering.raster.lighting import sky_weights
from valerie.rendering.raster.shadows import even_directions
from valerie.rendering.sky import sky_of
from valerie.testing.assets import simple_asset


def test_sky_weights_add_up_to_the_mean_light_of_all_directions() -> None:
    sky = sky_of(simple_asset().base)
    directions = even_directions(32)
    by_sky, by_sun, ground = np.array([0.2, 0.3, 0.4]), np.array([1.0, 0.8, 0.6]), np.array([0.1, 0.2, 0.1])
    steps = np.random.default_rng(0).integers(0, 256, 32)
    hidden, weights = sky_weights(sky, directions, by_sky, by_sun, ground)
    found = hidden + np.tensordot(steps, weights, 1)

    # Direction by direction, as light that arrives from the upper half of the sphere and a uniform lower half.
    expected = np.zeros((4, 4))
    for direction, radiance, step in zip(directions, sky.radiance(directions), steps, strict=True):
        back = np.array([-direction[0], -direction[1], 0.2])
        facing = max(float(back @ sky.sun_direction) / float(np.linalg.norm(back)), 0.0)
        share = step / 255
        light = np.append(radiance * share + (by_sky + by_sun * facing) * (1 - share), share)
        expected += np.outer(light, [1, *(3 * direction)]) / 64
    expected[:3] += np.outer(ground, [0.5, 0, 0, -0.75])
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)
