"""Measure the graphics card: frames by EGL, predictions and training by CUDA, each beside the processors of the machine.

``python -m benchmarks.bench_gpu [--software FOLDER]`` writes ``var/bench/gpu.json``. Every part runs in its own process, the
GPU's parts twice, since two processes must agree bit for bit.

- ``frames``: 24 frames of `urban-street`, 3 cameras × 4 kinds of light and weather × 2 poses. The first pose of a camera and
  light is the cold frame: background, layer, truth. The labels and pictures are compared with those of Mesa's software renderer.
  On a machine without Mesa, ``--software`` names a folder written elsewhere with ``--frames FOLDER``.
- ``predictions``: the shipped networks in torch on these frames, compared with fp32 on the processors.
- ``training``: steps of both networks on these frames.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from benchmarks import results
from valerie.labels import PERSON, to_train_ids
from valerie.parameters.definitions import Value

CAMERAS: Final = ("camera-1", "camera-2", "camera-3")
LIGHTS: Final[tuple[dict[str, Value], ...]] = (
    {"scene.sun-1.azimuth": 150.0, "scene.sun-1.elevation": 35.0},
    {"scene.sun-1.azimuth": 255.0, "scene.sun-1.elevation": 12.0},
    {"scene.environment-1.cloud_cover": 1.0, "scene.environment-1.rain": 4.0},
    {"scene.sun-1.elevation": -8.0},
)
POSES: Final[tuple[dict[str, Value], ...]] = (
    {"scene.person-1.pos.x": 2.0, "scene.person-1.pos.y": 12.0, "scene.person-1.character": "black-outfit"},
    {"scene.person-1.pos.x": 4.0, "scene.person-1.pos.y": 26.0, "scene.person-1.character": "yellow-shirt"},
)
SIZES: Final = ((960, 540), (1920, 1080))
NETWORKS: Final = ("deeplabv3plus-small", "semantic-fpn-small")
#: (device, precision); the first is the reference.
MODES: Final = (("cpu", "fp32"), ("cuda", "fp32"), ("cuda", "bf16"), ("cuda", "fp16"))
TRAINING_STEPS: Final = 30
_NO_CARD: Final = "EGL has no graphics card here: gpu-1 and gpu-2 are frames of the software renderer"
#: Makes libEGL load Mesa, and Mesa its software renderer.
SOFTWARE: Final = {
    "__EGL_VENDOR_LIBRARY_FILENAMES": "/usr/share/glvnd/egl_vendor.d/50_mesa.json",
    "LIBGL_ALWAYS_SOFTWARE": "1",
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--software", type=Path, help="frames of the software renderer, written elsewhere")
    parser.add_argument("--frames", type=Path, help="only write the frames of this machine's driver to this folder")
    parser.add_argument("--part", nargs="+", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.part:
        name, *words = arguments.part
        print(json.dumps(PARTS[name](*words)))
    elif arguments.frames:
        print(json.dumps(frames(str(arguments.frames)), indent=2))
    else:
        results.write("gpu", measure(arguments.software))


def measure(software: Path | None) -> dict[str, Any]:
    """Measure all parts that this machine has hardware for; a part without it says so."""
    with tempfile.TemporaryDirectory(prefix="valerie-bench-") as name:
        folder = Path(name)
        figures: dict[str, Any] = {"frames": _frames(folder, software)}
        show("frames", figures["frames"])
        for network in NETWORKS:
            modes = {
                f"{device} {precision}": _prediction(folder, network, device, precision) for device, precision in MODES
            }
            _compare_predictions(folder, network, modes)
            figures[f"predictions of {network}"] = modes
            show(f"predictions of {network}", modes)
        for network in NETWORKS:
            rows = {
                f"{device} {precision}": part("training", str(folder / "gpu-1"), network, device, precision)
                for device, precision in (("cpu", "fp32"), ("cuda", "fp32"), ("cuda", "bf16"))
            }
            rows["cuda fp32 again"] = part("training", str(folder / "gpu-1"), network, "cuda", "fp32")
            figures[f"training of {network}"] = rows
            show(f"training of {network}", rows)
    return figures


def _frames(folder: Path, software: Path | None) -> dict[str, Any]:
    rows = {f"gpu-{number}": part("frames", str(folder / f"gpu-{number}")) for number in (1, 2)}
    if software is None:
        rows["software"] = part("frames", str(folder / "software"), environment=SOFTWARE)
        software = folder / "software"
    else:
        rows["software"] = json.loads((software / "figures.json").read_text())
    return {
        **rows,
        "two processes": compare(folder / "gpu-1", folder / "gpu-2"),
        "gpu and software": compare(folder / "gpu-1", software),
        **({"not measured": _NO_CARD} if rows["gpu-1"].get("numeric_class", "").startswith("llvmpipe") else {}),
    }


def part(name: str, *words: str, environment: dict[str, str] | None = None) -> dict[str, Any]:
    """Run a part in its own process; a part that fails returns its last line of error."""
    command = [sys.executable, "-m", "benchmarks.bench_gpu", "--part", name, *words]
    process = subprocess.run(
        command, capture_output=True, text=True, check=False, env={**os.environ, **(environment or {})}
    )
    if process.returncode:
        print(process.stderr[-3000:], file=sys.stderr, flush=True)
        return {"not measured": process.stderr.strip().splitlines()[-1]}
    row: dict[str, Any] = json.loads(process.stdout.strip().splitlines()[-1])
    return row


def frames(folder: str) -> dict[str, Any]:
    """Draw the frames of both sizes; write labels, instances, depth and pictures of the small ones, and the times of all."""
    from valerie import plugins
    from valerie.rendering.base import View
    from valerie.scene.assets.asset import load_asset
    from valerie.scene.variation.variant import apply
    from valerie.sensing.sensor import develop
    from valerie.sensing.settings import SensorSetting

    asset = load_asset("urban-street")
    engine, truth_pass = plugins.create_renderer("raster"), plugins.create_truth_pass("")
    small = View(CAMERAS[0], 96, 54)
    for pose in POSES:  # Shaders are compiled and meshes uploaded once per process.
        scene = apply({**LIGHTS[0], **pose}, asset)
        engine.background(scene, small)
        engine.layer(scene, small)
        truth_pass.parts(scene, small)
    kept: dict[str, list[NDArray[Any]]] = {"classes": [], "instances": [], "depth": [], "pictures": []}
    figures: dict[str, Any] = {"numeric_class": engine.numeric_class}
    for width, height in SIZES:
        walls: dict[str, list[float]] = {"cold": [], "warm": []}
        cpus: dict[str, list[float]] = {"cold": [], "warm": []}
        for camera in CAMERAS:
            view = View(camera, width, height)
            for light in LIGHTS:
                for number, pose in enumerate(POSES):
                    kind = "warm" if number else "cold"
                    wall, cpu = time.perf_counter(), time.process_time()
                    scene = apply({**light, **pose}, asset)
                    if kind == "cold":
                        background = engine.background(scene, view)
                    layer = engine.layer(scene, view)
                    still, moving = truth_pass.parts(scene, view)
                    walls[kind].append(time.perf_counter() - wall)
                    cpus[kind].append(time.process_time() - cpu)
                    if (width, height) == SIZES[0]:
                        truth = moving.over(still)
                        kept["classes"].append(truth.class_map)
                        kept["instances"].append(truth.instance_map)
                        kept["depth"].append(truth.depth)
                        kept["pictures"].append(develop(layer.over(background).pixels, SensorSetting()))
        figures[f"{width}x{height}"] = {
            kind: {"wall_ms": round(1e3 * median(walls[kind]), 1), "cpu_ms": round(1e3 * median(cpus[kind]), 1)}
            for kind in walls
        }
    out = Path(folder)
    out.mkdir(parents=True, exist_ok=True)
    np.savez_compressed(out / "frames.npz", **{name: np.stack(arrays) for name, arrays in kept.items()})  # type: ignore[arg-type]
    (out / "figures.json").write_text(json.dumps(figures))
    return figures


def compare(one: Path, other: Path) -> dict[str, Any]:
    """Compare two folders of frames: pixels with another class or instance, how many of them are at an edge, and pictures."""
    if not (one / "frames.npz").exists() or not (other / "frames.npz").exists():
        return {"not measured": "one side has no frames"}
    a, b = np.load(one / "frames.npz"), np.load(other / "frames.npz")
    differs = (a["classes"] != b["classes"]) | (a["instances"] != b["instances"])
    labels = b["classes"].astype(np.int32) * 1000 + b["instances"]
    largest, smallest = (ranked(labels, size=(1, 3, 3)) for ranked in (ndimage.maximum_filter, ndimage.minimum_filter))
    same = ~differs & np.isfinite(a["depth"]) & np.isfinite(b["depth"])
    depth = np.abs(a["depth"][same] - b["depth"][same]) / b["depth"][same]
    pictures = np.abs(a["pictures"].astype(np.int16) - b["pictures"].astype(np.int16))
    return {
        "pixels": int(differs.size),
        "other labels": int(differs.sum()),
        "of these beside an edge": int((differs & (largest != smallest)).sum()),
        "depth, 99.9 % within": float(np.quantile(depth, 0.999)),
        "picture values, mean difference": float(pictures.mean()),
        "picture values, 99.9 % within": float(np.quantile(pictures, 0.999)),
        "picture values, largest": int(pictures.max()),
        "equal bits": bool(all(np.array_equal(a[name], b[name]) for name in a.files)),
    }


def _prediction(folder: Path, network: str, device: str, precision: str) -> dict[str, Any]:
    out = folder / f"{network} {device} {precision}"
    row = part("predictions", str(folder / "gpu-1"), f"{out}.npz", network, device, precision)
    if (device, precision) == ("cuda", "fp32") and "not measured" not in row:
        part("predictions", str(folder / "gpu-1"), f"{out} again.npz", network, device, precision)
        one, again = (np.load(f"{out}{name}.npz")["labels"] for name in ("", " again"))
        row["two processes, equal bits"] = bool(np.array_equal(one, again))
    return row


def predictions(folder: str, out: str, network: str, device: str, precision: str) -> dict[str, Any]:
    """Predict the labels of the frames in two orders, so that batches differ, and time both sizes."""
    from valerie.perception.running.batches import predicted
    from valerie.perception.running.opening import open_function
    from valerie.perception.shipped import file_document, function_path

    pictures = np.load(Path(folder) / "frames.npz")["pictures"]
    path = function_path(network)
    document = file_document(network, path).model_copy(update={"engine": "torch", "precision": precision})
    threads = len(os.sched_getaffinity(0)) if device == "cpu" else 1
    function = open_function(document, path, threads=threads, device=device)
    labels = np.stack([labels for _, labels in predicted(function, enumerate(pictures))])
    mixed = np.stack([labels for _, labels in predicted(function, enumerate(pictures[::-1][1:]))][::-1])
    row: dict[str, Any] = {
        "numeric_class": function.numeric_class,
        "threads": threads,
        "other labels in other batches": int((labels[:-1] != mixed).sum()),
    }
    for width, height in SIZES:
        large = [
            picture.repeat(height // picture.shape[0], axis=0).repeat(width // picture.shape[1], axis=1)
            for picture in pictures[:8]
        ]
        list(predicted(function, enumerate(large)))
        wall, cpu = time.perf_counter(), time.process_time()
        list(predicted(function, enumerate(large)))
        row[f"{width}x{height}"] = {
            "wall_ms": round(1e3 * (time.perf_counter() - wall) / len(large), 1),
            "cpu_ms": round(1e3 * (time.process_time() - cpu) / len(large), 1),
        }
    np.savez_compressed(out, labels=labels)
    return row


def _compare_predictions(folder: Path, network: str, modes: dict[str, dict[str, Any]]) -> None:
    """Add the agreement of labels with the reference, and the change of pACC in points."""
    device, precision = MODES[0]
    reference = np.load(folder / f"{network} {device} {precision}.npz")["labels"]
    person = to_train_ids(np.load(folder / "gpu-1" / "frames.npz")["classes"]) == PERSON.train_id
    visible = person.sum(axis=(1, 2))

    def scores(labels: NDArray[np.uint8]) -> NDArray[np.float64]:
        found = ((labels == PERSON.train_id) & person).sum(axis=(1, 2))
        scored: NDArray[np.float64] = found[visible > 0] / visible[visible > 0]
        return scored

    for name, row in modes.items():
        path = folder / f"{network} {name}.npz"
        if "not measured" in row:
            continue
        labels = np.load(path)["labels"]
        change = 100 * (scores(labels) - scores(reference))
        row["equal labels, %"] = round(100 * float((labels == reference).mean()), 4)
        row["pacc, points"] = {"mean": round(float(change.mean()), 3), "largest": round(float(np.abs(change).max()), 2)}


def training(folder: str, network: str, device: str, precision: str) -> dict[str, Any]:
    """Train on the frames; return the losses at both ends, the time of a step and a digest of the weights."""
    from valerie.perception.training.fit import train
    from valerie.perception.training.frame_folder import TrainingFrame
    from valerie.perception.training.training_settings import TrainingSettings

    stored = np.load(Path(folder) / "frames.npz")
    samples = [
        TrainingFrame(picture=picture, train_ids=to_train_ids(classes), site_seed=0)
        for picture, classes in zip(stored["pictures"], stored["classes"], strict=True)
    ]
    steps = TRAINING_STEPS if device == "cuda" else TRAINING_STEPS // 3
    settings = TrainingSettings.model_validate(
        {
            "architecture": network,
            "steps": steps,
            "batch": 8,
            "precision": precision,
            "device": device,
            "loader_threads": 4,
        }
    )
    losses: list[float] = []
    times: list[float] = []

    def note(progress: Any) -> None:
        losses.append(progress.loss)
        times.append(time.perf_counter())

    model = train(settings, samples, progress=note, threads=len(os.sched_getaffinity(0)))
    weights = hashlib.sha256(b"".join(value.numpy().tobytes() for value in model.network.state_dict().values()))
    return {
        "steps": steps,
        "first losses": [round(loss, 4) for loss in losses[:5]],
        "last losses": [round(loss, 4) for loss in losses[-5:]],
        "wall_ms a step": round(1e3 * median(np.diff(times).tolist()), 1),
        "weights": weights.hexdigest()[:12],
    }


def show(title: str, rows: dict[str, Any]) -> None:
    print(title)
    for name, row in rows.items():
        print(f"  {name}: {json.dumps(row)}", flush=True)


PARTS: Final[dict[str, Callable[..., dict[str, Any]]]] = {
    "frames": frames,
    "predictions": predictions,
    "training": training,
}

if __name__ == "__main__":
    main()
