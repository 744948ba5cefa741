"""Measure the shipped networks on the paper's pattern: pACC, precision and mIoU, over frames with a person and over all.

``python -m benchmarks.bench_networks [--data-dir DIR] [--cycles]``. Runs ``examples/pattern-sample.yaml`` with ``valerie run``,
which reuses the products of the data folder, and reads the stored confusion matrices. With ``--cycles``, Cycles renders the
same variants too, at quality ``draft``, which takes hours on two cores.

The aim applies to pooled counts over the frames with at least 100 visible pixels of persons, since smaller persons are only
specks. The table also shows frame means, and figures over all frames.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from benchmarks import results
from valerie.db import runs
from valerie.db.engine import reading
from valerie.db.results import predictions
from valerie.errors import ValerieError
from valerie.labels import PERSON
from valerie.loading import load_document
from valerie.metrics.collection import Averages, collection_scores
from valerie.metrics.matrix import ConfusionMatrix
from valerie.pipeline.base.context import open_context
from valerie.pipeline.base.resolved_runs import resolve_stored
from valerie.rendering.cycles.blender import interpreter
from valerie.settings import Settings, load_settings
from valerie.storage import codecs

SPEC: Final = Path("examples/pattern-sample.yaml")
#: Smallest number of visible pixels of persons in a frame that counts for the aim.
LEAST_PIXELS: Final = 100
#: Aims for the pooled figures on frames of the raster engine.
AIMS: Final = {"pacc": 0.85, "precision": 0.75, "miou": 0.60}
CYCLES: Final = {"name": "cycles", "quality": "draft"}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data-dir", type=Path, help="data folder (default: that of `valerie run`)")
    parser.add_argument("--cycles", action="store_true", help="the same variants rendered by Cycles too")
    parser.add_argument("--spec", type=Path, default=SPEC, help=f"another validation (default: {SPEC})")
    arguments = parser.parse_args()
    try:
        settings = load_settings(data_dir=arguments.data_dir)
        document = load_document(arguments.spec.read_bytes())
        if arguments.cycles:
            interpreter(settings)  # Fail before the other engine takes minutes.
        engines: dict[str, Mapping[str, Any]] = {"raster": {"name": "raster"}}
        if arguments.cycles:
            engines["cycles"] = CYCLES
        figures: dict[str, Any] = {"spec": str(arguments.spec), "least_person_pixels": LEAST_PIXELS, "aims": AIMS}
        for engine, renderer in engines.items():
            run_id, state = validate(
                {**document, "name": f"{document['name']}-{engine}", "renderer": dict(renderer)}, settings
            )
            figures[engine] = {"run": run_id, "state": state, "functions": measured(settings, run_id)}
            show(engine, figures[engine]["functions"], aims=AIMS if engine == "raster" else {})
            if state != "completed":
                print(f"the run is {state}; these figures leave out the frames that failed")
    except (ValerieError, OSError) as error:
        raise SystemExit(str(error)) from None
    results.write("networks", figures)


def validate(document: Mapping[str, Any], settings: Settings) -> tuple[str, str]:
    """Run a validation with ``valerie run``, which reports its progress; return the run's id and its final state.

    Raises:
        SystemExit: the run did not end with results.
    """
    command = [sys.executable, "-m", "valerie", "run", "-", "--data-dir", str(settings.data_dir), "--json"]
    process = subprocess.run(command, input=json.dumps(document), stdout=subprocess.PIPE, text=True, check=False)
    events = [json.loads(line) for line in process.stdout.splitlines() if line.startswith("{")]
    finished = next((event for event in events if event["event"] == "finished"), None)
    if finished is None or finished["summary"] is None:
        raise SystemExit(process.returncode or 1)
    return str(finished["run"]), str(finished["state"])


def measured(settings: Settings, run_id: str) -> dict[str, Any]:
    """Return the figures of each function over the run's evaluated frames with the first sensor setting."""
    context = open_context(settings)
    try:
        with reading(context.engine) as connection:
            run = runs.get(connection, run_id)
            stored = resolve_stored(run, settings)
            scores = {
                name: predictions(connection, run_id, 0, index)
                for index, name in enumerate(stored.resolved.spec.functions)
            }
    finally:
        context.engine.dispose()
    return {
        name: {
            "digest": stored.pins.functions[name].digest,
            **statistics([codecs.decode_counts(packed) for _, packed in rows.values()]),
        }
        for name, rows in scores.items()
    }


def statistics(matrices: Sequence[ConfusionMatrix], least: int = LEAST_PIXELS) -> dict[str, Any]:
    """Return figures over the frames with at least ``least`` visible pixels of persons, and over all frames.

    Args:
        matrices: (19, 20) per frame; the row of the true class person counts visible pixels.
        least: smallest number of visible pixels.
    """
    visible = [matrix for matrix in matrices if matrix[PERSON.train_id].sum() >= least]
    return {"visible": figures_of(visible), "all": figures_of(matrices)}


def figures_of(matrices: Sequence[ConfusionMatrix]) -> dict[str, Any]:
    """Return ratios in [0, 1]: pooled, and as means over the frames in which they are defined, with the number of these."""
    scores = collection_scores(matrices)
    person = scores.of(PERSON)
    both: dict[str, Averages] = {
        "pacc": person.pacc, "precision": person.precision, "iou": person.iou, "miou": scores.overall.miou
    }  # fmt: skip
    return {
        "frames": scores.frames,
        "pooled": {name: entry.pooled for name, entry in both.items()},
        "frame_mean": {name: entry.frames.mean for name, entry in both.items()},
        "defined_in": {name: entry.frames.defined for name, entry in both.items()},
    }


def show(engine: str, functions: Mapping[str, Any], aims: Mapping[str, float]) -> None:
    """Print a line per function, choice of frames and average, and a line on the aim."""
    names = ("pacc", "precision", "iou", "miou")
    heads = ("pACC", "precision", "IoU", "mIoU")
    wide = max(len(name) for name in functions)
    print(f"\n{engine}, in per cent: persons, and the mean IoU of the classes present")
    print(f"{'':{wide}}  {'frames':32}" + "".join(f"{head:>15}" for head in heads))
    for function, figures in functions.items():
        for frames, words in (("visible", f"≥ {LEAST_PIXELS} person pixels"), ("all", "all")):
            part = figures[frames]
            for average in ("pooled", "frame_mean"):
                label = f"{words}, {average.replace('_', ' ')}"
                counts = part["defined_in"] if average == "frame_mean" else dict.fromkeys(names, part["frames"])
                cells = "".join(f"{cell(part[average][name], counts[name]):>15}" for name in names)
                print(f"{function:{wide}}  {label:32}{cells}")
        pooled = figures["visible"]["pooled"]
        verdicts = (f"{heads[names.index(name)]} {verdict(pooled[name], aim)}" for name, aim in aims.items())
        if aims:
            print(f"{function:{wide}}  aim: {', '.join(verdicts)}")


def cell(value: float | None, count: int) -> str:
    return f"{'undefined' if value is None else f'{100 * value:.1f}'} ({count})"


def verdict(value: float | None, aim: float) -> str:
    word = "undefined" if value is None else "reached" if value >= aim else "missed"
    return f"{word} (≥ {100 * aim:.0f})"


if __name__ == "__main__":
    main()
