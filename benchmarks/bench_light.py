"""Compare the brightness of a street in the raster engine and in Cycles: ratios per class under five skies.

``make bench-light``, or ``python -m benchmarks.bench_light [--asset A --sky S --width W --height H --samples N]``; about four
minutes of one core. It renders the background of an asset from ``camera-1``. With ``--sky scene``, Cycles has the raster engine's
sky. A class's ratio is that of its mean linear values in the two engines. The *difference* of a sky is the geometric mean, over
all pixels except the sky's, of the ratio of the brighter to the darker engine.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from benchmarks import results
from valerie.errors import ValerieError
from valerie.labels import BY_ID, SKY
from valerie.parameters.definitions import Value
from valerie.rendering.base import View
from valerie.rendering.cycles.renderer import CyclesRenderer
from valerie.rendering.cycles.settings import CyclesSettings
from valerie.rendering.ground_truth import TruthPass
from valerie.rendering.raster.renderer import RasterRenderer
from valerie.scene.assets.asset import load_asset
from valerie.scene.variation.variant import apply

SKIES: Final[dict[str, Mapping[str, Value]]] = {
    "clear": {},
    "low sun": {"scene.sun-1.elevation": 25.0, "scene.sun-1.azimuth": 120.0},
    "overcast": {"scene.environment-1.cloud_cover": 1.0},
    "along the street": {"scene.sun-1.azimuth": 190.0},
    "rain": {"scene.environment-1.cloud_cover": 1.0, "scene.environment-1.rain": 15.0},
}
#: Smallest share of the picture that a reported class covers.
LEAST: Final = 0.01
#: Linear value below which every tone curve gives black.
BLACK: Final = 2e-3


def compared(raster: NDArray[Any], cycles: NDArray[Any], classes: NDArray[np.uint8]) -> dict[str, Any]:
    """Return the ratios of one picture from two (H, W, 3) linear images and (H, W) class ids."""
    first, second = (np.maximum(pixels.astype(np.float64).mean(axis=2), BLACK) for pixels in (raster, cycles))
    ratios = {}
    for label in np.unique(classes):
        where = classes == label
        if where.mean() >= LEAST:
            ratios[BY_ID[int(label)].name] = round(float(first[where].mean() / second[where].mean()), 2)
    visible = classes != SKY.id
    apart = np.exp(np.abs(np.log(first[visible] / second[visible])).mean())
    return {"ratios": ratios, "difference": round(float(apart), 2)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--asset", default="urban-street")
    parser.add_argument("--width", type=int, default=320)
    parser.add_argument("--height", type=int, default=180)
    parser.add_argument("--samples", type=int, default=16, help="samples of Cycles, denoised")
    arguments = parser.parse_args()
    asset, view = load_asset(arguments.asset), View("camera-1", arguments.width, arguments.height)
    figures: dict[str, Any] = {
        "asset": arguments.asset,
        "width": arguments.width,
        "height": arguments.height,
        "samples": arguments.samples,
        "skies": {},
    }
    try:
        raster, truth = RasterRenderer(), TruthPass()
        cycles = CyclesRenderer(CyclesSettings(samples=arguments.samples, denoise=True))
        for name, values in SKIES.items():
            scene = apply(values, asset)
            classes = truth.parts(scene, view)[0].class_map
            first, second = raster.background(scene, view).pixels, cycles.background(scene, view).pixels
            comparison = figures["skies"][name] = compared(first, second, classes)
            ratios = "  ".join(f"{label} {ratio:.2f}" for label, ratio in comparison["ratios"].items())
            print(f"{name:9} difference {comparison['difference']:.2f}   raster / cycles: {ratios}", flush=True)
    except ValerieError as error:
        raise SystemExit(str(error)) from None
    results.write("light", figures)


if __name__ == "__main__":
    main()
