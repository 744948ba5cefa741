"""Measure the costs of products and write the shipped table.

``OMP_NUM_THREADS=1 LP_NUM_THREADS=1 python -m benchmarks.costs [--write] [--only truth] [--sizes]``

The costs are CPU seconds of this process with warm caches (the first product of each kind does not count). They include the
worker's decoding of inputs and encoding of the product. Two resolutions give the fixed and the per-megapixel part. On a busy
machine, ``--sizes`` keeps the seconds that were measured on an idle one.

``start`` is not measured here: it is the CPU time of all processes of `valerie run examples/first-run.yaml` in a new data
folder, minus that of the products.
"""

from __future__ import annotations

import argparse
import json
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import numpy as np

from valerie import plugins
from valerie.errors import MissingDependency
from valerie.labels import to_train_ids
from valerie.metrics.confusion import confusion_matrix
from valerie.metrics.instances import person_counts
from valerie.perception.shipped import FUNCTIONS, load_function
from valerie.rendering.annotations.boxes import measure_boxes
from valerie.rendering.annotations.joints import measure_joints
from valerie.rendering.annotations.kinds import AnnotationKind
from valerie.rendering.base import View
from valerie.rendering.person_light import measure_light
from valerie.rendering.raster.renderer import RasterRenderer
from valerie.rendering.visibility import measure
from valerie.scene.assets.asset import load_asset
from valerie.scene.variation.variant import apply
from valerie.sensing.sensor import develop
from valerie.sensing.settings import SensorSetting
from valerie.storage import codecs
from valerie.storage.annotation_codecs import Annotation, encode_annotation

RESOLUTIONS = ((960, 540), (1920, 1080))
SUNS_DEG = (150.0, 210.0, 240.0)
CAMERAS = ("camera-1", "camera-2", "camera-3")
#: The part that the truths of a camera share; not a separate product.
STATICS: Final = "statics"
PLACES_M = (8.0, 12.0, 16.0, 20.0, 30.0)
#: `benchmarks.bench_cycles` measures Cycles, which takes minutes per picture; its entries are kept.
ENGINES = ("raster", "pyrender")
TABLE = Path(__file__).parents[1] / "valerie" / "runs" / "forecasting" / "costs.json"

#: (kind, maker) and resolution to (CPU seconds, bytes) of each product.
Samples = dict[tuple[str, str], dict[tuple[int, int], list[tuple[float, int]]]]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="replace the shipped table")
    parser.add_argument("--only", choices=PARTS, help="measure one part and keep the other entries")
    parser.add_argument("--sizes", action="store_true", help="measure bytes only and keep the seconds")
    arguments = parser.parse_args()
    samples: Samples = defaultdict(lambda: defaultdict(list))
    for name, part in PARTS.items():
        if arguments.only in (None, name):
            part(samples)
    text = json.dumps(table(samples, sizes_only=arguments.sizes), indent=2) + "\n"
    print(text)
    if arguments.write:
        TABLE.write_text(text, "utf-8")


def measure_images(samples: Samples) -> None:
    asset = load_asset("urban-street")
    for name in ENGINES:
        try:
            engine = plugins.create_renderer(name)
        except (MissingDependency, ModuleNotFoundError) as error:
            print(f"{name}: not measured ({error})")
            continue
        for width, height in RESOLUTIONS:
            view = View("camera-1", width, height)
            for sun in SUNS_DEG:
                scene = apply({"scene.sun-1.azimuth": sun}, asset)
                with timed(samples, "background", name, view) as done:
                    done(codecs.encode_image(engine.background(scene, view)))
                for y in PLACES_M:
                    scene = apply({"scene.sun-1.azimuth": sun, "scene.person-1.pos.y": y}, asset)
                    with timed(samples, "layer", name, view) as done:
                        done(codecs.encode_layer(engine.layer(scene, view)))
        engine.close()


def measure_truth(samples: Samples) -> None:
    asset, truth_pass = load_asset("urban-street"), plugins.create_truth_pass("")
    for width, height in RESOLUTIONS:
        for camera in CAMERAS:
            view = View(camera, width, height)
            with timed(samples, STATICS, "", view) as done:
                done(codecs.encode_truth(truth_pass.parts(apply({}, asset), view)[0]))
        view = View("camera-1", width, height)
        for y in PLACES_M:
            scene = apply({"scene.person-1.pos.y": y}, asset)
            with timed(samples, "truth", "", view) as done:
                statics, layer = truth_pass.parts(scene, view)
                truth = layer.over(statics)
                measure(truth, scene, view)
                data = codecs.encode_truth_layer(layer, "0" * 32)
                done(data)
            predicted = np.where(truth.class_map == 23, 10, 0).astype(np.uint8)
            with timed(samples, "evaluation", "", view) as done:
                stored = codecs.decode_stored_truth(data)
                assert isinstance(stored, codecs.StoredTruthLayer)
                truth = stored.layer.over(statics)
                counts = confusion_matrix(to_train_ids(truth.class_map), predicted)
                person_counts(truth, predicted)
                done(codecs.encode_counts(counts))
    truth_pass.close()


def measure_annotations(samples: Samples) -> None:
    """Measure the annotations of single frames; the light includes the preparation of its inputs."""
    asset = load_asset("urban-street")
    truth_pass, engine = plugins.create_truth_pass(""), RasterRenderer()
    for width, height in RESOLUTIONS:
        view = View("camera-1", width, height)
        background = engine.background(apply({}, asset), view)
        for y in PLACES_M:
            scene = apply({"scene.person-1.pos.y": y}, asset)
            statics, part = truth_pass.parts(scene, view)
            truth, layer = part.over(statics), engine.layer(scene, view)
            makers: dict[AnnotationKind, Callable[[], Annotation]] = {
                AnnotationKind.NORMALS: lambda: truth_pass.normals(scene, view),  # noqa: B023  # called at once
                AnnotationKind.BOXES: lambda: measure_boxes(scene, view, truth),  # noqa: B023
                AnnotationKind.JOINTS: lambda: measure_joints(scene, view, truth),  # noqa: B023
            }
            for kind, make in makers.items():
                with timed(samples, kind.value, "", view) as done:
                    done(encode_annotation(kind, make()))
            with timed(samples, AnnotationKind.LIGHT.value, "", view) as done:
                measure_light(part.over(statics), layer.over(background), scene, view, engine)
                done(b"")
    engine.close()
    truth_pass.close()


def measure_functions(samples: Samples) -> None:
    """Measure the shipped functions on pictures of the street, since realistic label maps compress well."""
    asset, engine = load_asset("urban-street"), RasterRenderer()
    pictures = {}
    for width, height in RESOLUTIONS:
        scenes = (apply({"scene.person-1.pos.y": y}, asset) for y in PLACES_M)
        pictures[width, height] = [engine.full(scene, View("camera-1", width, height)) for scene in scenes]
    engine.close()
    for name in FUNCTIONS:
        function = load_function(name)
        for (width, height), images in pictures.items():
            for image in images:
                with timed(samples, "prediction", name, View("camera-1", width, height)) as done:
                    done(codecs.encode_prediction(function.predict(develop(image.pixels, SensorSetting()))))


PARTS: Final = {
    "images": measure_images,
    "truth": measure_truth,
    "annotations": measure_annotations,
    "functions": measure_functions,
}


class timed:  # noqa: N801  reads as a statement
    """Context manager that records CPU seconds and bytes of one product."""

    def __init__(self, samples: Samples, kind: str, maker: str, view: View) -> None:
        self._into = samples[kind, maker][view.width, view.height]

    def __enter__(self) -> Any:
        self._started = time.process_time()
        return self._done

    def _done(self, data: bytes) -> None:
        self._into.append((time.process_time() - self._started, len(data)))

    def __exit__(self, *_: object) -> None:
        pass


def table(samples: Samples, *, sizes_only: bool) -> dict[str, Any]:
    known: dict[str, Any] = json.loads(TABLE.read_text("utf-8"))
    # Entries without a new measurement are kept, such as those of Cycles.
    costs: dict[str, dict[str, Any]] = known["costs"]
    for (kind, maker), by_resolution in samples.items():
        # The first product of each resolution fills caches.
        means = [np.mean(by_resolution[r][1:], axis=0) for r in RESOLUTIONS]
        megapixels = [width * height / 1e6 for width, height in RESOLUTIONS]
        slope = np.maximum((means[1] - means[0]) / (megapixels[1] - megapixels[0]), 0.0)
        fixed = np.maximum(means[0] - slope * megapixels[0], 0.0)
        seconds = {
            "cpu_seconds": round(float(fixed[0]), 4),
            "cpu_seconds_per_megapixel": round(float(slope[0]), 4),
        }
        sizes = {"bytes": round(float(fixed[1])), "bytes_per_megapixel": round(float(slope[1]))}
        before = known[STATICS] if kind == STATICS else costs.setdefault(kind, {}).setdefault(maker, {})
        before.update({**({} if sizes_only and before else seconds), **sizes})
    return {**known, "machine": machine()}


def machine() -> str:
    lines = Path("/proc/cpuinfo").read_text("utf-8").splitlines()
    model = next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), "unknown CPU")
    return f"one core of {model}, llvmpipe, asset urban-street"


if __name__ == "__main__":
    main()
