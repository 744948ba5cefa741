"""Measure the paper's two networks: CPU seconds per full-HD frame, in eager fp32 and in every engine and precision.

``python -m benchmarks.bench_infer [--threads 1] [--frames 2] [--networks NAME …] [--size 1920x1080]``. Every row is a separate
process that opens the function as a worker does. The large networks are mmsegmentation's deeplabv3plus_r101-d8 and fpn_r101 with
random weights, which does not affect the cost. The agreement of labels is measured with the trained small networks on rendered
frames, against eager fp32: the network in plain torch, without VALERIE's engine, on the input that every engine gets.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks import results
from valerie.perception.shipped import FUNCTIONS

#: The paper's pair, at output strides 8 and 32.
LARGE = ("deeplabv3plus-r101c-os8", "semantic-fpn-r101c")
NETWORKS = (*LARGE, *FUNCTIONS)
MODES = (
    ("eager", "fp32"),
    ("torch", "fp32"),
    ("onnxruntime", "fp32"),
    ("openvino", "fp32"),
    ("torch", "bf16"),
    ("openvino", "bf16"),
    ("openvino", "fp16"),
    ("openvino", "int8"),
    ("onnxruntime", "int8"),
)
WIDTH, HEIGHT = 1920, 1080


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--frames", type=int, default=2, help="number of timed frames of the large networks")
    parser.add_argument(
        "--networks", nargs="+", choices=NETWORKS, default=NETWORKS, metavar="NAME", help="default: all"
    )
    parser.add_argument("--size", default=f"{WIDTH}x{HEIGHT}", help="size of the frames; default: %(default)s")
    parser.add_argument(
        "--row", nargs=3, metavar=("NETWORK", "ENGINE", "PRECISION"), help="one row, in this process, as JSON"
    )
    parser.add_argument("--folder", type=Path)
    arguments = parser.parse_args()
    if arguments.row:
        network, engine, precision = arguments.row
        row = measure(network, engine, precision, arguments.folder, arguments.threads, arguments.frames)
        print(json.dumps(row))
        return
    networks = arguments.networks
    width, height = (int(side) for side in arguments.size.split("x"))
    figures: dict[str, Any] = {"width": width, "height": height, "threads": arguments.threads, "processor": processor()}
    with tempfile.TemporaryDirectory(prefix="valerie-bench-") as name:
        folder = Path(name)
        in_own_process("render", folder, width, height)
        in_own_process("write", folder, *networks)
        for network in networks:
            rows = figures[network] = {}
            for engine, precision in MODES:
                options = ["--row", network, engine, precision, f"--folder={folder}"]
                limits = [f"--threads={arguments.threads}", f"--frames={arguments.frames}"]
                rows[f"{engine} {precision}"] = row = run([*options, *limits])
                row["agreement"] = agreement(folder, network, engine, precision)
                if "cpu_s_per_frame" in row:
                    row["speed_up"] = round(rows["eager fp32"]["cpu_s_per_frame"] / row["cpu_s_per_frame"], 2)
                show(network, engine, precision, row)
    print("", *table({name: figures[name] for name in networks}), "", sep="\n")
    summarise(figures)
    whole = networks == NETWORKS and (width, height) == (WIDTH, HEIGHT)
    results.write("infer" if whole else "infer-part", figures)


def run(arguments: list[str]) -> dict[str, Any]:
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OMP_WAIT_POLICY": "PASSIVE"}
    command = [sys.executable, "-m", "benchmarks.bench_infer", *arguments]
    process = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    if process.returncode:
        raise SystemExit(process.stderr)
    row: dict[str, Any] = json.loads(process.stdout.strip().splitlines()[-1])
    return row


def in_own_process(task: str, folder: Path, *arguments: object) -> None:
    call = f"{task}(Path({str(folder)!r}), *{arguments!r})"
    program = f"from pathlib import Path; from benchmarks.bench_infer import {task}; {call}"
    subprocess.run([sys.executable, "-c", program], check=True, env={**os.environ, "LP_NUM_THREADS": "0"})


def render(folder: Path, width: int, height: int) -> None:
    """Render frames of the street with the pedestrian near and far, for two directions of the sun."""
    from valerie import plugins
    from valerie.rendering.base import View
    from valerie.scene.assets.asset import load_asset
    from valerie.scene.variation.variant import apply
    from valerie.sensing.sensor import develop
    from valerie.sensing.settings import SensorSetting

    asset, view = load_asset("urban-street"), View("camera-1", width, height)
    renderer = plugins.create_renderer("raster")
    places = ((150.0, 9.0), (150.0, 22.0), (240.0, 14.0))
    pictures = []
    for sun, y in places:
        scene = apply({"scene.sun-1.azimuth": sun, "scene.person-1.pos.y": y}, asset)
        pictures.append(develop(renderer.full(scene, view).pixels, SensorSetting()))
    np.save(folder / "pictures.npy", np.stack(pictures))


def write(folder: Path, *networks: str) -> None:
    """Write the files of the large networks, with random weights."""
    import torch

    from valerie.perception.importing.function_file import function_file_bytes
    from valerie.perception.networks.architectures import build_network

    torch.manual_seed(0)
    for name in (name for name in networks if name in LARGE):
        state = build_network(name).state_dict()
        tensors = {key: value.numpy() for key, value in state.items() if not key.endswith("num_batches_tracked")}
        content = function_file_bytes(
            tensors, architecture=name, mean=(0.485, 0.456, 0.406), std=(0.229, 0.224, 0.225), provenance={}
        )
        (folder / f"{name}.safetensors").write_bytes(content)


def measure(network: str, engine: str, precision: str, folder: Path, threads: int, frames: int) -> dict[str, Any]:
    """Measure seconds per frame after a first frame in this process, and write the labels to the folder."""
    from valerie.errors import MissingDependency
    from valerie.perception.running.adaptation import plan
    from valerie.perception.running.opening import open_function
    from valerie.perception.running.quantizing import quantize
    from valerie.perception.shipped import file_document, function_path

    pictures = np.load(folder / "pictures.npy")
    path = folder / f"{network}.safetensors" if network in LARGE else function_path(network)
    document = file_document(network, path)
    piece = plan(document.input, *pictures.shape[1:3]).piece
    if precision == "int8":  # by the pictures that it is measured on, since only its cost matters here
        document, data = quantize(document, path, pictures)
        path = folder / f"{network} int8.onnx"
        path.write_bytes(data)
    started = time.process_time()
    if engine == "eager":
        predict, numeric_class = eager(path, threads), "eager"
    else:
        document = document.model_copy(update={"engine": engine, "precision": precision})
        try:
            function = open_function(document, path, threads=threads, device="cpu")
        except MissingDependency as error:
            return {"not_here": str(error)}
        predict, numeric_class = function.predict, function.numeric_class
    if network in LARGE:
        pictures = pictures[:frames]
        if engine != "eager":
            predict(pictures[0])  # compiles
    else:
        predict(pictures[0])
    opened = time.process_time()
    seconds, labels = [], []
    for picture in pictures:
        start = time.process_time()
        labels.append(predict(picture))
        seconds.append(time.process_time() - start)
    np.save(folder / f"{network} {engine} {precision}.npy", np.stack(labels))
    from valerie.perception.networks.architectures import (
        ARCHITECTURES,
    )  # Imports torch, so it must come after the last timed frame.

    return {
        "cpu_s_per_frame": round(median(seconds), 3),
        "open_and_first_frame_cpu_s": round(opened - started, 2),
        "peak_mb": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024),
        "numeric_class": numeric_class,
        "output_stride": ARCHITECTURES[network].backbone.output_stride,
        "given": [piece.width, piece.height],
    }


def eager(path: Path, threads: int) -> Callable[[NDArray[np.uint8]], NDArray[np.uint8]]:
    """Return a function that runs the network in plain torch: default memory format, fp32 throughout, one operation at a time.

    Frames are reduced and padded as the file's document says, as for every engine.
    """
    import torch
    from torch.nn import functional

    from valerie.perception.importing.network_weights import load_network
    from valerie.perception.running.adaptation import plan
    from valerie.perception.shipped import file_document

    torch.set_num_threads(threads)
    input_document = file_document(path.stem, path).input
    network, header = load_network(path)
    mean, std = torch.tensor(header.mean).view(1, 3, 1, 1), torch.tensor(header.std).view(1, 3, 1, 1)

    def predict(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
        steps = plan(input_document, *picture.shape[:2])
        (piece,) = steps.pieces(picture)
        with torch.inference_mode():
            values = torch.from_numpy(piece.copy()).permute(2, 0, 1)[None].contiguous().float().div(255)
            logits = network((values - mean) / std)
            full = functional.interpolate(logits, size=tuple(steps.labels), mode="bilinear", align_corners=False)
            return steps.joined([full.argmax(1)[0].to(torch.uint8).numpy()])

    return predict


def agreement(folder: Path, network: str, engine: str, precision: str) -> float | None:
    path = folder / f"{network} {engine} {precision}.npy"
    if not path.exists():
        return None
    return round(float((np.load(path) == np.load(folder / f"{network} eager fp32.npy")).mean()), 6)


def show(network: str, engine: str, precision: str, row: dict[str, Any]) -> None:
    if "not_here" in row:
        print(f"{network:22} {engine:12} {precision}   {row['not_here']}", flush=True)
        return
    if engine == "eager":
        print("{}: output stride {}, input {} × {}".format(network, row["output_stride"], *row["given"]))
    random = "  (random weights)" if network in LARGE else ""
    print(
        f"{network:22} {engine:12} {precision} {row['cpu_s_per_frame']:8.2f} CPU s {row['speed_up']:6.2f} × "
        f"{row['peak_mb']:6} MB   same labels as eager fp32 {100 * row['agreement']:8.4f} %{random}",
        flush=True,
    )


def table(figures: dict[str, Any]) -> list[str]:
    """Return a Markdown table of CPU seconds per frame of all networks; speed-ups only for those with an aim."""
    heads, rows = [], []
    for network, modes in figures.items():
        facts = modes["eager fp32"]
        heads.append("`{}`, output stride {}, given {} × {}".format(network, facts["output_stride"], *facts["given"]))
    for mode in (f"{engine} {precision}" for engine, precision in MODES):
        cells = []
        for network, modes in figures.items():
            row = modes[mode]
            cell = "–" if "not_here" in row else "{:.3g}".format(row["cpu_s_per_frame"])
            ratio = network in LARGE and "speed_up" in row and mode != "eager fp32"
            cells.append(f"{cell} ({row['speed_up']:.2f} ×)" if ratio else cell)
        rows.append([mode, *cells])
    lines = [["CPU seconds per frame", *heads], ["---"] * (1 + len(heads)), *rows]
    return [f"| {' | '.join(line)} |" for line in lines]


def summarise(figures: dict[str, Any]) -> None:
    for network in (name for name in LARGE if name in figures):
        rows = {mode: row for mode, row in figures[network].items() if "speed_up" in row and mode != "eager fp32"}
        fastest = max(rows, key=lambda mode: rows[mode]["speed_up"])
        single = max((mode for mode in rows if mode.endswith("fp32")), key=lambda mode: rows[mode]["speed_up"])
        figures[network]["fastest"] = {"mode": fastest, "speed_up": rows[fastest]["speed_up"], "aim": 4.0}
        figures[network]["fastest fp32"] = {"mode": single, "speed_up": rows[single]["speed_up"], "aim": 1.5}
        print(
            f"{network}: fastest is {fastest}, {rows[fastest]['speed_up']:.2f} times eager fp32 (aim 4); in fp32 it is {single}, "
            f"{rows[single]['speed_up']:.2f} times (aim 1.5)"
        )


def processor() -> str:
    from benchmarks.costs import machine
    from valerie.perception.running.engines.processor import instruction_set

    return f"{machine().partition(',')[0].removeprefix('one core of ')}, {instruction_set()}"


if __name__ == "__main__":
    main()
