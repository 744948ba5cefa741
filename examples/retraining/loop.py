"""Close the loop back to training: validate, find the weak region, train against it, validate again.

Trains twice from the same weights for the same number of steps: on frames drawn until they show the weakness, and on as many
frames drawn anywhere. It prints and writes the result, good or bad (``comparison.json``, ``comparison.png``).

    make example-loop
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from rich.console import Console

from valerie.analysis.comparison.drawing import comparison_renderable, draw_comparison
from valerie.cli.progress_lines import ProgressLines
from valerie.pipeline.base.context import Context, open_context
from valerie.pipeline.functions.references import open_reference
from valerie.pipeline.retraining.comparison import Grouping, compare_on_run
from valerie.pipeline.retraining.retrain import TrainingResources, Watcher, register_retrained, retrain
from valerie.pipeline.retraining.weakness import find_weakness
from valerie.runs.study.retraining import RetrainSettings
from valerie.settings import load_settings

HERE = Path(__file__).parent
FUNCTION = "semantic-fpn-small"


def main() -> int:
    options = _parser().parse_args()
    out, data = options.out, options.out / "data"
    settings = RetrainSettings(
        frames=options.frames, sites=options.sites, steps=options.steps, batch=4, held_out_frames=0
    )
    _say("1. validate (products that are there already are not made again)")
    run_id = _validate(data)
    context = open_context(load_settings(data_dir=data))
    try:
        close_the_loop(
            context, run_id, options.where, settings, out, threads=options.threads, processes=options.processes
        )
    finally:
        context.engine.dispose()
    return 0


def close_the_loop(
    context: Context,
    run_id: str,
    where: str,
    settings: RetrainSettings,
    out: Path,
    *,
    threads: int = 1,
    processes: int = 1,
) -> dict[str, Any]:
    """Train two new versions, one on targeted frames and one on as many drawn anywhere, and compare them with the run.

    Args:
        context: of the deployment that has the run.
        run_id: of a validation with `FUNCTION`.
        where: the weakness.
        settings: of both trainings.
        out: folder of frames, function files, ``comparison.json`` and ``comparison.png``.
        threads: torch's CPU threads, in training.
        processes: number of processes that render.

    Returns:
        The content of ``comparison.json``.
    """
    started = time.monotonic()
    _say(f"2. read where {FUNCTION} is weak: {where}")
    weakness = find_weakness(context, run_id, where, FUNCTION)
    _say(f"   {weakness.selected} of {weakness.evaluated} persons; region: {weakness.region}")
    versions = [FUNCTION]
    training_sets: dict[str, object] = {}
    for name, targeted in (("targeted", True), ("random", False)):
        _say(f"3. {name} frames, and {settings.steps} steps of training on them")
        lines = ProgressLines("steps")
        retrained = retrain(
            weakness,
            out / f"{name}.safetensors",
            settings.model_copy(update={"targeted": targeted}),
            folder=out / name,
            resources=TrainingResources(processes, threads),
            watcher=Watcher(
                on_site=lambda shard: _say(f"   site {shard.site_seed}: {len(shard.sizes)} frames"),
                on_step=lambda now, lines=lines: lines.tell(  # type: ignore[misc]
                    now.step, now.steps, now.step / max(now.elapsed_s, 1e-9)
                ),
            ),
        )
        _say(f"   {retrained.frames} frames of {retrained.drawn:,} drawn scenes, sites {retrained.site_seeds}")
        registered, _ = register_retrained(context, retrained, f"{FUNCTION}-{name}")
        versions.append(registered.document.name)
        training_sets[name] = {"frames": retrained.frames, "drawn": retrained.drawn, "reference": registered.reference}
    _say("4. the same validation again: the same frames, nothing is rendered")
    lines = ProgressLines("frames")
    comparison = compare_on_run(
        context,
        run_id,
        versions,
        open_function=lambda name: open_reference(name, context=context),
        grouping=Grouping(where, weakness.region),
        progress=lines.tell,
    )
    Console(highlight=False, width=None if sys.stdout.isatty() else 150).print(comparison_renderable(comparison))
    document = {
        "run": run_id,
        "function": FUNCTION,
        "where": where,
        "region": weakness.region.model_dump(mode="json"),
        "settings": settings.model_dump(mode="json"),
        "training_sets": training_sets,
        "seconds": round(time.monotonic() - started),
        **comparison.as_document(),
    }
    (out / "comparison.json").write_text(json.dumps(document, indent=1, ensure_ascii=False) + "\n")
    title = f"{FUNCTION}, before and after {settings.steps} steps on {settings.frames} frames"
    draw_comparison(comparison, out / "comparison.png", title=title)
    _say(f"\nwrote {out / 'comparison.json'} and {out / 'comparison.png'}")
    return document


def _validate(data: Path) -> str:
    """Run the validation through the real system and return the run's id."""
    command = [sys.executable, "-m", "valerie", "run", str(HERE / "validation.yaml"), "--data-dir", str(data), "--json"]
    process = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True, env={**os.environ})
    events = [json.loads(line) for line in process.stdout.splitlines() if line.startswith("{")]
    return str(next(event["run"] for event in events if event["event"] == "finished"))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("var/example-loop"), help="folder of all results")
    parser.add_argument("--where", default="pacc < 0.5 and distance_m > 25", help="the weakness")
    parser.add_argument("--frames", type=int, default=24, help="training frames of each kind")
    parser.add_argument("--sites", type=int, default=3)
    parser.add_argument("--steps", type=int, default=120)
    parser.add_argument("--threads", type=int, default=1, help="torch's CPU threads")
    parser.add_argument("--processes", type=int, default=1, help="number of processes that render")
    return parser


def _say(line: str) -> None:
    sys.stderr.write(line + "\n")
    sys.stderr.flush()


if __name__ == "__main__":
    sys.exit(main())
