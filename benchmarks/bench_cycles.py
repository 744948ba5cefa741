"""What Cycles costs and how far its images are from the light itself; writes ``var/bench/cycles.json``.

* presets: samples with and without denoiser against a picture of many samples: error and CPU seconds.
* reach: what a pedestrian changes by indirect light, by its distance in body heights, beside the noise.
* frames: layer over background against the whole frame, beside the difference of two seeds; with ``--functions`` also the
  paired difference of pACC.

``python -m benchmarks.bench_cycles [--width W --height H --reference SAMPLES --frames N --functions NAME …]``. The validation of
docs/cycles.md at full size: ``--width 960 --height 540 --frames 100 --functions deeplabv3plus-small semantic-fpn-small``.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks import results
from valerie import plugins
from valerie.rendering.base import LinearImage, Rectangle, View
from valerie.rendering.cycles.reach import reached_rectangle
from valerie.rendering.cycles.renderer import CyclesRenderer
from valerie.rendering.cycles.settings import CyclesSettings
from valerie.rendering.ground_truth import TruthPass
from valerie.rendering.raster.bounds import grown
from valerie.scene.asset import SceneAsset, load_asset
from valerie.scene.model import Scene
from valerie.scene.variation import apply
from valerie.sensing.sensor import SensorSetting, develop

Pixels = NDArray[np.float64]


def engine(**settings: Any) -> CyclesRenderer:
    return CyclesRenderer(CyclesSettings.model_validate(settings))


def place(asset: SceneAsset, index: int) -> Scene:
    """A pedestrian on the road, at one place after the other."""
    return apply(
        {"scene.person-1.pos.x": 1.0 + 0.37 * (index % 8), "scene.person-1.pos.y": 8.0 + 1.3 * (index % 11)}, asset
    )


def timed(made: CyclesRenderer, call: Callable[[], LinearImage]) -> tuple[LinearImage, float]:
    """The picture, and Blender's CPU seconds for it."""
    before = made.cpu_seconds_elsewhere
    return call(), made.cpu_seconds_elsewhere - before


def levels(image: LinearImage) -> Pixels:
    """Grey levels 0…255 after the default sensor."""
    return np.asarray(develop(image.pixels, SensorSetting()), np.float64)


def rms(first: Pixels, second: Pixels, where: Rectangle | None = None) -> float:
    part = slice(None) if where is None else where.slices
    return float(np.sqrt(((first[part] - second[part]) ** 2).mean()))


def presets(asset: SceneAsset, view: View, samples: int) -> dict[str, Any]:
    scene = place(asset, 0)
    best = engine(samples=samples, denoise=False, seed=9)
    reference, cost = timed(best, lambda: best.background(scene, view))
    found: dict[str, Any] = {"reference": {"samples": samples, "denoise": False, "cpu_s": round(cost, 1)}}
    linear = np.minimum(reference.pixels.astype(np.float64), 2)
    for count in (16, 64, 256):
        for denoise in (False, True):
            made = engine(samples=count, denoise=denoise)
            image, cost = timed(made, lambda made=made: made.background(scene, view))  # type: ignore[misc]
            figures = {
                "rmse_grey_levels": round(rms(levels(image), levels(reference)), 2),
                "rmse_linear": round(rms(np.minimum(image.pixels.astype(np.float64), 2), linear), 4),
                "cpu_s": round(cost, 1),
                "cpu_s_per_megapixel": round(cost / (view.width * view.height / 1e6), 1),
            }
            name = f"{count}{' + OIDN' if denoise else ''}"
            found[name] = figures
            print(f"{name:12}", figures)
    return found


def reach(asset: SceneAsset, view: View, truth_pass: TruthPass) -> dict[str, Any]:
    """Share by which a pedestrian changes light outside its own pixels and shadow, in rings of half a body height."""
    scene = place(asset, 0)
    made, height = engine(samples=64, denoise=False), 1.8
    # The same seed: a path that does not meet the person has the same value in both.
    without, with_person = made.background(scene, view).pixels, made.full(scene, view).pixels
    other = engine(samples=64, denoise=True, seed=1).background(scene, view).pixels
    smooth = engine(samples=64, denoise=True).background(scene, view).pixels
    truth = truth_pass.truth(scene, view)
    camera, node = scene.cameras[view.camera], scene.world_transform("scene.person-1")
    focal = camera.focal_length_px(view.width)
    rows, columns = np.mgrid[0 : view.height, 0 : view.width]
    rays = np.stack(
        [(columns + 0.5 - view.width / 2) / focal, -(rows + 0.5 - view.height / 2) / focal, -np.ones(rows.shape)], 2
    )
    seen = np.isfinite(truth.depth) & (truth.instance_map != 24001)
    points = camera.position + (rays @ camera.transform[:3, :3].T) * np.where(seen, truth.depth, 0)[..., None]
    distance = np.linalg.norm((points - node[:3, 3])[..., :2], axis=2) / height
    gray = [image.astype(np.float64).mean(axis=2) for image in (without, with_person, smooth, other)]
    toward = scene.sun_direction()
    offset = points - node[:3, 3]
    shadow = np.abs(offset[..., 0] * toward[1] - offset[..., 1] * toward[0]) < 0.6 * np.hypot(*toward[:2])
    shadow &= (offset[..., :2] @ toward[:2]) < 0.6
    found: dict[str, Any] = {}
    for low in np.arange(0.0, 3.0, 0.25):
        ring = seen & ~shadow & (distance >= low) & (distance < low + 0.25)
        if ring.sum() >= 12:
            found[f"{low:.2f}"] = {
                "pixels": int(ring.sum()),
                "change": round(float((gray[1] - gray[0])[ring].sum() / gray[0][ring].sum()), 4),
                "noise": round(float(np.sqrt(((gray[3] - gray[2])[ring] ** 2).mean()) / gray[2][ring].mean()), 4),
            }
            print(f"reach {low:.2f} heights", found[f"{low:.2f}"])
    return found


def frames(asset: SceneAsset, view: View, truth_pass: TruthPass, count: int, functions: list[str]) -> dict[str, Any]:
    made, other = engine(), engine(seed=1)
    loaded = {name: plugins.create_function(name) for name in functions}
    background = made.background(place(asset, 0), view)
    rows: list[dict[str, Any]] = []
    for index in range(count):
        scene = place(asset, index)
        before = made.cpu_seconds_elsewhere
        layer = made.layer(scene, view)
        layer_cost = made.cpu_seconds_elsewhere - before
        joined = layer.over(background)
        full, cost = timed(made, lambda scene=scene: made.full(scene, view))  # type: ignore[misc]
        reseeded = other.full(scene, view)
        around = grown(reached_rectangle(scene, view), 16, view)
        row: dict[str, Any] = {"layer_cpu_s": round(layer_cost, 2), "full_cpu_s": round(cost, 2)}
        for name, where in (("rectangle", layer.rectangle), ("around", around), ("image", None)):
            row[name] = {
                "layer": round(rms(levels(joined), levels(full), where), 3),
                "seeds": round(rms(levels(reseeded), levels(full), where), 3),
            }
        person = truth_pass.truth(scene, view).class_map == 24
        for name, function in loaded.items():
            if person.any():
                score = [
                    float((function.predict(develop(image.pixels, SensorSetting()))[person] == 11).mean())
                    for image in (joined, full)
                ]
                row[name] = round(100 * (score[0] - score[1]), 3)
        rows.append(row)
        print("frame", index, row)
    found: dict[str, Any] = {"frames": rows}
    for name in functions:
        differences = np.array([row[name] for row in rows if name in row])
        drawn = np.random.default_rng(0).choice(differences, (2000, len(differences))).mean(axis=1)
        found[name] = {
            "mean_pacc_points": round(float(differences.mean()), 3),
            "interval_90": [round(float(q), 3) for q in np.quantile(drawn, (0.05, 0.95))],
            "largest": round(float(np.abs(differences).max()), 3),
        }
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--width", type=int, default=192)
    parser.add_argument("--height", type=int, default=108)
    parser.add_argument("--reference", type=int, default=1024, help="samples of the reference picture")
    parser.add_argument("--frames", type=int, default=3)
    parser.add_argument("--functions", nargs="*", default=[])
    given = parser.parse_args()
    asset, view, truth_pass = load_asset("urban-street"), View("camera-1", given.width, given.height), TruthPass()
    results.write(
        "cycles",
        {
            "width": given.width,
            "height": given.height,
            "numeric_class": engine().numeric_class,
            "frames": frames(asset, view, truth_pass, given.frames, given.functions),
            "reach": reach(asset, view, truth_pass),
            "presets": presets(asset, view, given.reference),
        },
    )


if __name__ == "__main__":
    main()
