"""Measure cost and error of Cycles' pictures, and compare a layer over a background with the full frame.

``python -m benchmarks.bench_cycles [STEP …]``, of

* ``render``: renders parts of frames into ``--folder``. Resumes after Ctrl-C or a crash. Needs Blender.
* ``score``: scores all parts rendered so far, into ``var/bench/cycles.json``. Compares layers with full frames, and two seeds
  with each other, in grey levels and pACC. Compares qualities with a reference of many samples: error, pACC, CPU seconds. Needs
  no Blender; the networks may have changed since.
* ``reach``: measures the change of indirect light around a pedestrian by distance in body heights, and the noise.

Without a step, all three run at a small size. The validation in docs/benchmarks.md takes hours; `benchmarks.cycles_frames`
explains its windows and samples:
``render score --width 960 --height 540 --frames 100 --presets 10``.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import cycles_scores, results
from benchmarks.cycles_frames import Planned, planned
from benchmarks.cycles_parts import Parts
from benchmarks.cycles_render import Studio
from valerie import plugins
from valerie.errors import ValerieError
from valerie.perception.shipped import FUNCTIONS
from valerie.rendering.base import View
from valerie.rendering.cycles.blender import BlenderHolder
from valerie.rendering.cycles.renderer import CyclesRenderer
from valerie.rendering.cycles.settings import CyclesSettings
from valerie.rendering.ground_truth import TruthPass
from valerie.scene.assets.asset import SceneAsset, load_asset
from valerie.scene.variation.variant import apply
from valerie.settings import load_settings

STEPS = ("render", "score", "reach")
#: Smallest distance of pedestrians in the table of presets: 1024 samples of a near pedestrian's window cost too much.
PRESETS_BEYOND_M = 32.0
#: Smallest number of their visible pixels: hidden pedestrians have no pACC.
PRESETS_VISIBLE = 100


def render(folder: Path, asset: SceneAsset, frames: list[Planned], *, seeds: int, presets: int) -> None:
    """Render all frames: the first ``seeds`` with two seeds, the first ``presets`` distant, visible ones at every quality."""
    holder = BlenderHolder(load_settings())
    engine = CyclesRenderer(holder=holder)
    size = frames[0].view
    setup = {
        "asset": asset.digest,
        "revision": engine.revision,
        "numeric_class": engine.numeric_class,
        "width": size.width,
        "height": size.height,
    }
    started, count = time.monotonic(), 0
    try:
        parts = Parts(folder, setup)
        studio = Studio(parts, holder)
        for frame in frames:
            rendered = studio.frame(frame, other_seed=frame.index < seeds)
            visible = parts.figures(f"{frame.index}/person")["pixels"] >= PRESETS_VISIBLE
            if presets and visible and frame.distance_m >= PRESETS_BEYOND_M:
                presets -= 1
                rendered |= studio.presets(frame)
            count += rendered
            if rendered:
                pace = (time.monotonic() - started) / count
                left = pace * (len(frames) - 1 - frame.index) / 3600
                print(
                    f"frame {frame.index + 1} of {len(frames)}: {pace:.0f} s each, about {left:.1f} h left", flush=True
                )
    finally:
        holder.close()


def score(folder: Path, frames: list[Planned], functions: list[str]) -> dict[str, Any]:
    parts = Parts(folder, json.loads((folder / "setup.json").read_text()))
    scores = cycles_scores.Scores(parts, folder, {name: plugins.create_function(name) for name in functions})
    return {
        "setup": json.loads((folder / "setup.json").read_text()),
        "checks": [parts.figures(f"{frame.index}/checks") for frame in frames if f"{frame.index}/checks" in parts],
        "layers": cycles_scores.of_layers(parts, frames, scores),
        "presets": cycles_scores.of_presets(parts, frames, scores),
    }


def engine(**settings: Any) -> CyclesRenderer:
    return CyclesRenderer(CyclesSettings.model_validate(settings))


def reach(asset: SceneAsset, view: View, truth_pass: TruthPass) -> dict[str, Any]:
    """Return the relative change of light outside a pedestrian's pixels and shadow, in rings of a quarter of a body height."""
    scene = apply({"scene.person-1.pos.x": 1.0, "scene.person-1.pos.y": 8.0}, asset)
    renderer, height = engine(samples=64, denoise=False), 1.8
    # With the same seed, a path that does not hit the person has the same value in both.
    without, with_person = renderer.background(scene, view).pixels, renderer.full(scene, view).pixels
    other = engine(samples=64, denoise=True, seed=1).background(scene, view).pixels
    smooth = engine(samples=64, denoise=True).background(scene, view).pixels
    truth = truth_pass.truth(scene, view)
    camera, node = scene.cameras[view.camera], scene.world_transform("scene.person-1")
    focal = camera.focal_length_px(view.width)
    rows, columns = np.mgrid[0 : view.height, 0 : view.width]
    rays = np.stack(
        [(columns + 0.5 - view.width / 2) / focal, -(rows + 0.5 - view.height / 2) / focal, -np.ones(rows.shape)], 2
    )
    visible = np.isfinite(truth.depth) & (truth.instance_map != 24001)
    points = camera.position + (rays @ camera.transform[:3, :3].T) * np.where(visible, truth.depth, 0)[..., None]
    distance = np.linalg.norm((points - node[:3, 3])[..., :2], axis=2) / height
    gray = [image.astype(np.float64).mean(axis=2) for image in (without, with_person, smooth, other)]
    toward = scene.sun_direction()
    offset = points - node[:3, 3]
    shadow = np.abs(offset[..., 0] * toward[1] - offset[..., 1] * toward[0]) < 0.6 * np.hypot(*toward[:2])
    shadow &= (offset[..., :2] @ toward[:2]) < 0.6
    rings: dict[str, Any] = {}
    for low in np.arange(0.0, 3.0, 0.25):
        ring = visible & ~shadow & (distance >= low) & (distance < low + 0.25)
        if ring.sum() >= 12:
            rings[f"{low:.2f}"] = {
                "pixels": int(ring.sum()),
                "change": round(float((gray[1] - gray[0])[ring].sum() / gray[0][ring].sum()), 4),
                "noise": round(float(np.sqrt(((gray[3] - gray[2])[ring] ** 2).mean()) / gray[2][ring].mean()), 4),
            }
            print(f"reach at {low:.2f} body heights:", rings[f"{low:.2f}"])
    return rings


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("steps", nargs="*", metavar="STEP", help=f"any of {', '.join(STEPS)}; default: all")
    parser.add_argument("--width", type=int, default=192)
    parser.add_argument("--height", type=int, default=108)
    parser.add_argument("--frames", type=int, default=3, help="number of pedestrians")
    parser.add_argument(
        "--seeds",
        type=int,
        help="number of pedestrians rendered with a second seed too, half of the work; all by default",
    )
    parser.add_argument("--presets", type=int, default=1, help="number of pedestrians at every quality")
    parser.add_argument("--functions", nargs="*", default=list(FUNCTIONS))
    parser.add_argument("--folder", type=Path, help="folder of the parts; default: var/bench/cycles-WIDTHxHEIGHT")
    arguments = parser.parse_args()
    steps = arguments.steps or list(STEPS)
    if unknown := set(steps) - set(STEPS):
        parser.error(f"unknown step: {', '.join(sorted(unknown))}; known: {', '.join(STEPS)}")
    folder = arguments.folder or Path(f"var/bench/cycles-{arguments.width}x{arguments.height}")
    asset = load_asset("urban-street")
    frames = planned(asset, arguments.width, arguments.height, arguments.frames)
    figures: dict[str, Any] = {}
    try:
        if "render" in steps:
            seeds = arguments.frames if arguments.seeds is None else arguments.seeds
            render(folder, asset, frames, seeds=seeds, presets=arguments.presets)
        if "score" in steps:
            figures |= score(folder, frames, arguments.functions)
        if "reach" in steps:
            figures["reach"] = reach(asset, View("camera-1", arguments.width, arguments.height), TruthPass())
    except KeyboardInterrupt:
        raise SystemExit("interrupted; run the same command again to resume") from None
    except ValerieError as error:
        raise SystemExit(str(error)) from None
    if figures:
        results.write("cycles", figures)


if __name__ == "__main__":
    main()
