"""``python -m valerie.perception.training frames|fit``: render a data set, train a network from it.

Needs numpy, torch, safetensors, zstandard, pydantic and OpenCV; rendering also moderngl, shapely, scipy and orjson.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

from pydantic import ValidationError

from valerie.errors import InvalidInput, ValerieError
from valerie.perception.training.frames import FrameFolder, Shard
from valerie.perception.training.provenance import training_provenance


def main(arguments: list[str] | None = None) -> int:
    """Run one of the two commands; 0 done, 2 wrong input, 1 any other failure that has a message."""
    options = _parser().parse_args(arguments)
    try:
        if options.command == "frames":
            _frames(options)
        else:
            _fit(options)
    except (InvalidInput, ValidationError) as error:
        sys.stderr.write(f"{error}\n")
        return 2
    except ValerieError as error:
        sys.stderr.write(f"{error}\n")
        return 1
    return 0


def _frames(options: argparse.Namespace) -> None:
    # The use case lives above this package (it joins asset, engine and sensor); only this entry point looks up.
    from valerie.pipeline.training_frames import FrameSettings, render_frames

    settings = FrameSettings(
        split=options.split,
        streets=options.streets,
        per_street=options.per_street,
        width=options.size[0],
        height=options.size[1],
        asset=options.asset,
    )
    started, done = time.monotonic(), 0

    def tell(shard: Shard) -> None:
        nonlocal done
        done += 1
        rate = done * settings.per_street / (time.monotonic() - started)
        _say(f"street {shard.street_seed}: {done}/{settings.streets} streets, {rate:.1f} frames/s")

    folder = render_frames(options.folder, settings, processes=options.processes, progress=tell)
    _say(f"{len(folder)} frames in {options.folder}, digest {folder.digest}")


def _fit(options: argparse.Namespace) -> None:
    from valerie.perception.training.curve import TrainingCurve
    from valerie.perception.training.fit import TrainingProgress, train
    from valerie.perception.training.settings import TrainingSettings

    given = {
        name: value for name in TrainingSettings.model_fields if (value := getattr(options, name, None)) is not None
    }
    settings = TrainingSettings.model_validate(given)
    frames, held_out = FrameFolder(options.frames), FrameFolder(options.held_out)
    curve_file = options.out.with_suffix(".curve.json")
    if options.checkpoint is None or not options.checkpoint.exists():
        curve_file.unlink(missing_ok=True)
    curve = TrainingCurve(curve_file)

    def tell(now: TrainingProgress) -> None:
        curve(now)
        if now.step % 50 == 0 or now.figures is not None:
            _say(f"step {now.step} ({now.fraction:.1%}), loss {now.loss:.4f}, {now.elapsed_s:.0f} s")
        if now.figures is not None:
            _say(f"  held out: {now.figures.as_text()}")

    model = train(
        settings,
        frames,
        held_out=held_out,
        progress=tell,
        checkpoint=options.checkpoint,
        start_from=options.start_from,
        threads=options.threads,
    )
    provenance = training_provenance(frames, held_out, options.start_from)
    provenance["trained-by"] = "python -m valerie.perception.training fit"
    if options.weaknesses:
        provenance["known-weaknesses"] = options.weaknesses
    data = model.to_bytes(provenance)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    options.out.write_bytes(data)
    _say(f"{options.out}: {len(data) / 1e6:.2f} MB after {model.steps} steps")
    if model.figures is not None:
        _say(f"held out: {model.figures.as_text()}")
    _say(f"curve: {curve.finish(model.steps, model.figures, title=f'{options.out.stem}, {len(frames)} frames')}")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m valerie.perception.training", description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)

    frames = commands.add_parser("frames", help="render a data set into an empty folder")
    frames.add_argument("folder", type=Path)
    frames.add_argument("--split", choices=("train", "held-out"), default="train")
    frames.add_argument("--streets", type=int, default=100)
    frames.add_argument("--per-street", type=int, default=30)
    frames.add_argument("--size", type=_size, default=(960, 540), metavar="WxH")
    frames.add_argument("--processes", type=int, default=1)
    frames.add_argument("--asset", default="urban-street")

    fit = commands.add_parser("fit", help="train one network from a folder of frames")
    fit.add_argument("architecture")
    fit.add_argument("--frames", type=Path, required=True, help="folder to train from")
    fit.add_argument("--held-out", type=Path, required=True, help="folder to validate on")
    fit.add_argument("--out", type=Path, required=True, help="function file to write")
    fit.add_argument("--start-from", type=Path, help="function file whose weights are the beginning")
    fit.add_argument("--checkpoint", type=Path, help="file to write on the way, and to go on from if it exists")
    fit.add_argument("--weaknesses", metavar="TEXT", help="what is known to go wrong, for the function's card")
    fit.add_argument("--steps", type=int)
    fit.add_argument("--time-budget", dest="time_budget_s", type=float, metavar="SECONDS")
    fit.add_argument("--batch", type=int)
    fit.add_argument("--seed", type=int)
    fit.add_argument("--learning-rate", type=float)
    fit.add_argument("--person-weight", type=float)
    fit.add_argument(
        "--keep-norm-statistics",
        action="store_const",
        const=True,
        help="batch normalisation keeps the statistics that it has; for going on from a trained network",
    )
    fit.add_argument("--precision", choices=("bf16", "fp32"))
    fit.add_argument("--device", choices=("auto", "cpu", "cuda"))
    fit.add_argument("--loader-threads", type=int)
    fit.add_argument("--validate-every", type=int)
    fit.add_argument("--threads", type=int, default=1, help="torch's CPU threads (part of what makes runs repeatable)")
    return parser


def _size(text: str) -> tuple[int, int]:
    width, _, height = text.partition("x")
    try:
        return int(width), int(height)
    except ValueError:
        raise argparse.ArgumentTypeError(f"not WIDTHxHEIGHT: {text}") from None


def _say(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
