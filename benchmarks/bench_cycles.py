"""What Cycles' pictures cost and how far they are from the light itself, and whether a layer over a background is the frame.

``python -m benchmarks.bench_cycles [STEP …]``, of

* ``render``: parts of frames, into ``--folder``. It goes on where it was ended (Ctrl-C, a crash), and takes Blender.
* ``score``: what there is so far, into ``var/bench/cycles.json``. Layers against full frames, beside two seeds: grey levels and
  pACC. Qualities against many samples: error, pACC, CPU seconds. Takes no Blender; networks may have changed since.
* ``reach``: what a pedestrian changes by indirect light, by its distance in body heights, beside the noise.

Without a step: all, small. The validation of docs/cycles.md, whose windows and samples `benchmarks.cycles_frames` explains:
``render score --width 960 --height 540 --frames 100 --presets 10``, hours.
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
#: Pedestrians of the table of presets stand at least so far away: 1024 samples of a near one's window cost too much.
PRESETS_BEYOND_M = 32.0
#: And show at least so many pixels: hidden ones have no pACC.
PRESETS_VISIBLE = 100


def render(folder: Path, asset: SceneAsset, frames: list[Planned], *, seeds: int, presets: int) -> None:
    """All frames; the first ``seeds`` in a second seed too, the first ``presets`` distant and visible ones at every quality."""
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
    started, done = time.monotonic(), 0
    try:
        parts = Parts(folder, setup)
        studio = Studio(parts, holder)
        for one in frames:
            made = studio.frame(one, other_seed=one.index < seeds)
            visible = parts.figures(f"{one.index}/person")["pixels"] >= PRESETS_VISIBLE
            if presets and visible and one.distance_m >= PRESETS_BEYOND_M:
                presets -= 1
                made |= studio.presets(one)
            done += made
            if made:
                pace = (time.monotonic() - started) / done
                left = pace * (len(frames) - 1 - one.index) / 3600
                print(f"frame {one.index + 1} of {len(frames)}: {pace:.0f} s each, about {left:.1f} h left", flush=True)
    finally:
        holder.close()


def score(folder: Path, frames: list[Planned], functions: list[str]) -> dict[str, Any]:
    parts = Parts(folder, json.loads((folder / "setup.json").read_text()))
    scores = cycles_scores.Scores(parts, folder, {name: plugins.create_function(name) for name in functions})
    return {
        "setup": json.loads((folder / "setup.json").read_text()),
        "checks": [parts.figures(f"{one.index}/checks") for one in frames if f"{one.index}/checks" in parts],
        "layers": cycles_scores.of_layers(parts, frames, scores),
        "presets": cycles_scores.of_presets(parts, frames, scores),
    }


def engine(**settings: Any) -> CyclesRenderer:
    return CyclesRenderer(CyclesSettings.model_validate(settings))


def reach(asset: SceneAsset, view: View, truth_pass: TruthPass) -> dict[str, Any]:
    """Share by which a pedestrian changes light outside its own pixels and shadow, in rings of half a body height."""
    scene = apply({"scene.person-1.pos.x": 1.0, "scene.person-1.pos.y": 8.0}, asset)
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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("steps", nargs="*", metavar="STEP", help=f"any of {', '.join(STEPS)}; all if not given")
    parser.add_argument("--width", type=int, default=192)
    parser.add_argument("--height", type=int, default=108)
    parser.add_argument("--frames", type=int, default=3, help="how many pedestrians")
    parser.add_argument(
        "--seeds", type=int, help="how many of them in a second seed too, half of the work; all if not given"
    )
    parser.add_argument("--presets", type=int, default=1, help="how many of them at every quality")
    parser.add_argument("--functions", nargs="*", default=list(FUNCTIONS))
    parser.add_argument("--folder", type=Path, help="of the parts; var/bench/cycles-WIDTHxHEIGHT if not given")
    given = parser.parse_args()
    steps = given.steps or list(STEPS)
    if unknown := set(steps) - set(STEPS):
        parser.error(f"no such step: {', '.join(sorted(unknown))}; there are {', '.join(STEPS)}")
    folder = given.folder or Path(f"var/bench/cycles-{given.width}x{given.height}")
    asset = load_asset("urban-street")
    frames = planned(asset, given.width, given.height, given.frames)
    figures: dict[str, Any] = {}
    try:
        if "render" in steps:
            seeds = given.frames if given.seeds is None else given.seeds
            render(folder, asset, frames, seeds=seeds, presets=given.presets)
        if "score" in steps:
            figures |= score(folder, frames, given.functions)
        if "reach" in steps:
            figures["reach"] = reach(asset, View("camera-1", given.width, given.height), TruthPass())
    except KeyboardInterrupt:
        raise SystemExit("ended; the same command goes on from here") from None
    except ValerieError as error:
        raise SystemExit(str(error)) from None
    if figures:
        results.write("cycles", figures)


if __name__ == "__main__":
    main()
