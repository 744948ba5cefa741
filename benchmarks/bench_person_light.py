"""Compare the irradiance of persons with that of a path tracer.

``make bench-person-light``, or ``python -m benchmarks.bench_person_light [--persons N --width W --height H --samples N]``; about
half an hour of one core. Persons stand all over `urban-street` (`benchmarks.cycles_frames`), under three suns. For the reference,
Cycles renders each of them in matte grey under the same sky, without denoising: the pixels' values divided by the grey's
reflectance are the light that arrives. Pixels at the person's edge are left out.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion

from benchmarks import results
from benchmarks.cycles_frames import GROUPS, Group, Planned, planned
from valerie.color import luminance_of
from valerie.errors import ValerieError
from valerie.rendering.base import LinearImage
from valerie.rendering.cycles.renderer import CyclesRenderer
from valerie.rendering.cycles.settings import CyclesSettings
from valerie.rendering.ground_truth import TruthPass
from valerie.rendering.person_light import measure_light
from valerie.rendering.raster.renderer import RasterRenderer
from valerie.rendering.sky import EXPOSURE
from valerie.scene.assets.asset import load_asset
from valerie.scene.graph.model import Material, Scene

#: Reflectance of the grey. Light that a person reflects onto itself counts as arriving, so it is that of usual clothes.
GREY: Final = 0.18
#: Smallest number of pixels of a compared person, without those at its edge.
LEAST_PIXELS: Final = 100
#: The sun ahead at 40°, low from the left, and ahead at 50°: the persons' visible sides are mostly in the shade.
SUNS: Final = (
    *GROUPS,
    Group("c", "camera-1", {"scene.sun-1.elevation": 50.0, "scene.sun-1.azimuth": 190.0}),
)
#: Share of persons that the interval of ratios contains.
SHARE: Final = 0.95


def grey(scene: Scene, instance_id: int) -> Scene:
    """Return the scene with one person in matte grey."""
    material = Material("grey", base_color=(GREY,) * 3, roughness=1.0, specular=0.0, double_sided=True)
    nodes = {
        path: replace(node, meshes=tuple(mesh.with_material(material.name) for mesh in node.meshes))
        if node.instance_id == instance_id
        else node
        for path, node in scene.nodes.items()
    }
    return replace(scene, nodes=nodes, materials={**scene.materials, material.name: material})


def ratio(frame: Planned, raster: RasterRenderer, cycles: CyclesRenderer, truth_pass: TruthPass) -> float | None:
    """Return the irradiance of the person divided by its reference; None if too little of the person is visible."""
    statics, part = truth_pass.parts(frame.scene, frame.view)
    truth = part.over(statics)
    instance_id = frame.scene.nodes["scene.person-1"].instance_id
    inside: NDArray[np.bool_] = binary_erosion(truth.instance_map == instance_id, np.ones((3, 3), np.bool_))
    if np.count_nonzero(inside) < LEAST_PIXELS:
        return None
    blank = LinearImage(np.zeros((frame.view.height, frame.view.width, 3), np.float16))
    lights = measure_light(truth, blank, frame.scene, frame.view, raster)
    measured = next(light.irradiance for light in lights if light.instance_id == instance_id)
    layer = cycles.layer(grey(frame.scene, instance_id), frame.view)
    arriving = luminance_of(layer.pixels.astype(np.float32))[inside[layer.rectangle.slices]]
    return None if measured is None else measured / float(arriving.mean() / GREY / EXPOSURE)


def figures_of(ratios: NDArray[np.float64]) -> dict[str, Any]:
    """Return the central interval of ``SHARE`` of the ratios, their median, and the share within 0.8 … 1.25."""
    low, middle, high = np.quantile(ratios, [(1 - SHARE) / 2, 0.5, (1 + SHARE) / 2])
    within = np.mean((ratios >= 0.8) & (ratios <= 1.25))
    return {"persons": ratios.size, **{name: round(float(value), 3) for name, value in {
        "low": low, "median": middle, "high": high, "least": ratios.min(), "largest": ratios.max(), "within": within,
    }.items()}}  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--persons", type=int, default=200)
    parser.add_argument("--width", type=int, default=640)
    parser.add_argument("--height", type=int, default=360)
    parser.add_argument("--samples", type=int, default=32, help="light paths per pixel of Cycles")
    arguments = parser.parse_args()
    asset = load_asset("urban-street")
    ratios: dict[str, list[float]] = {group.name: [] for group in SUNS}
    try:
        raster, truth_pass = RasterRenderer(), TruthPass()
        settings = CyclesSettings(samples=arguments.samples, denoise=False, clamp_indirect=0.0)
        cycles = CyclesRenderer(settings)
        # Half of them are hidden, or too small.
        for frame in planned(asset, arguments.width, arguments.height, arguments.persons * 5 // 2, SUNS):
            value = ratio(frame, raster, cycles, truth_pass)
            if value is None:
                continue
            ratios[frame.group.name].append(value)
            count = sum(map(len, ratios.values()))
            print(
                f"{count:4}/{arguments.persons}  {frame.group.name}  {frame.distance_m:5.1f} m  {value:.2f}", flush=True
            )
            if count == arguments.persons:
                break
    except ValerieError as error:
        raise SystemExit(str(error)) from None
    groups = {name: figures_of(np.array(values)) for name, values in ratios.items() if values}
    whole = figures_of(np.concatenate([np.array(values) for values in ratios.values()]))
    for name, figures in {**groups, "all": whole}.items():
        print(name, figures)
    results.write("person-light", {**vars(arguments), "groups": groups, "all": whole})


if __name__ == "__main__":
    main()
