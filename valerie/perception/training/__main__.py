"""``python -m valerie.perception.training frames|fit``: render a data set, train a network from it.

Needs numpy, torch, safetensors, zstandard, pydantic and OpenCV; rendering also moderngl, shapely, scipy and orjson.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import Final

from pydantic import ValidationError

from valerie.errors import InvalidInput, InvalidInputs, ValerieError
from valerie.perception.training.frame_folder import FrameFolder, Shard
from valerie.perception.training.provenance import training_provenance
from valerie.perception.training.settings import CropSettings, TrainingSettings
from valerie.perception.training.training_set import open_training_set
from valerie.validation import problem_of

#: Settings whose option is not called as they are.
_OPTIONS: Final = {
    "time_budget_s": "--time-budget",
    "architecture": "ARCHITECTURE",
    "width": "--size",
    "height": "--size",
    "folder": "DIR",
}


def main(arguments: list[str] | None = None) -> int:
    """Run one of the two commands; 0 done, 2 wrong input, 1 any other failure that has a message."""
    try:
        execute(arguments)
    except ValerieError as error:
        sys.stderr.write(f"{error}\n")
        return 2 if isinstance(error, InvalidInput) else 1
    return 0


def execute(arguments: list[str] | None = None, *, program: str = "python -m valerie.perception.training") -> None:
    """Run one of the two commands, which its help calls ``program`` frames and ``program`` fit.

    Raises:
        InvalidInput: an option is out of bounds; names it.
        ValerieError: what went wrong.
        SystemExit: help was asked for, or an option is unknown or missing.
    """
    options = command_parser(program).parse_args(arguments)
    try:
        if options.command == "frames":
            _frames(options)
        else:
            _fit(options, program)
    except ValidationError as error:
        raise InvalidInputs([problem_of(detail, _option(str(detail["loc"][0]))) for detail in error.errors()]) from None
    except InvalidInput as error:
        if type(error) is InvalidInput and error.field in vars(options):
            option = _option(error.field)
            raise InvalidInput(error.message, field=option, value=error.value, limit=error.limit) from None
        raise


def _option(setting: str) -> str:
    return _OPTIONS.get(setting, "--" + setting.replace("_", "-"))


def _frames(options: argparse.Namespace) -> None:
    # The use case lives above this package (it joins asset, engine and sensor); only this entry point looks up.
    from valerie.pipeline.retraining.training_frames import FrameSettings, render_frames

    settings = FrameSettings(
        split=options.split,
        streets=options.streets,
        per_street=options.per_street,
        width=options.size[0],
        height=options.size[1],
        asset=options.asset,
        first_seed=options.first_seed,
    )
    started, done = time.monotonic(), 0

    def tell(shard: Shard) -> None:
        nonlocal done
        done += 1
        rate = done * settings.per_street / (time.monotonic() - started)
        _say(f"street {shard.street_seed}: {done}/{settings.streets} streets, {rate:.1f} frames/s")

    folder = render_frames(options.folder, settings, processes=options.processes, progress=tell)
    _say(f"{len(folder)} frames in {options.folder}, digest {folder.digest}")


def _fit(options: argparse.Namespace, program: str) -> None:
    from valerie.perception.training.curve import TrainingCurve
    from valerie.perception.training.fit import TrainingProgress, train

    given = {
        name: value for name in TrainingSettings.model_fields if (value := getattr(options, name, None)) is not None
    }
    if options.scales is not None:
        given["crops"] = CropSettings(scales=options.scales)
    settings = TrainingSettings.model_validate(given)
    frames, held_out = open_training_set(options.frames), FrameFolder(options.held_out)
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
    provenance["trained-by"] = f"{program} fit"
    if options.weaknesses:
        provenance["known-weaknesses"] = options.weaknesses
    data = model.to_bytes(provenance)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    options.out.write_bytes(data)
    _say(f"{options.out}: {len(data) / 1e6:.2f} MB after {model.steps} steps")
    if model.figures is not None:
        _say(f"held out: {model.figures.as_text()}")
    _say(f"curve: {curve.finish(model.steps, model.figures, title=f'{options.out.stem}, {len(frames)} frames')}")


def command_parser(program: str) -> argparse.ArgumentParser:
    """The options of ``program`` frames and ``program`` fit."""
    parser = argparse.ArgumentParser(prog=program, description="Render a training set, or train a network from one.")
    commands = parser.add_subparsers(dest="command", required=True)

    about = "Render a training set into an empty folder: streets of seeds that no run uses by default."
    frames = commands.add_parser("frames", help="render a training set", description=about)
    frames.add_argument("folder", type=Path, metavar="DIR", help="empty folder to render into")
    frames.add_argument(
        "--split", choices=("train", "held-out"), default="train", help="which streets (default: train)"
    )
    frames.add_argument(
        "--first-seed", type=int, metavar="N", help="where the street seeds begin (default: with the split)"
    )
    frames.add_argument("--streets", type=int, default=100, metavar="N", help="how many streets (default: 100)")
    frames.add_argument("--per-street", type=int, default=30, metavar="N", help="frames of each street (default: 30)")
    frames.add_argument(
        "--size", type=_size, default=(960, 540), metavar="WxH", help="of the frames, pixels (default: 960x540)"
    )
    frames.add_argument("--processes", type=int, default=1, metavar="N", help="that render (default: 1)")
    frames.add_argument(
        "--asset",
        default="urban-street",
        metavar="NAME",
        help="generated asset that takes a seed (default: urban-street)",
    )

    about = "Train one network from folders of frames and write it as a function file."
    fit = commands.add_parser("fit", help="train one network from folders of frames", description=about)
    fit.add_argument("architecture", metavar="ARCHITECTURE", help="semantic-fpn-small, deeplabv3plus-small, …")
    fit.add_argument(
        "--frames",
        type=Path,
        required=True,
        action="append",
        metavar="DIR",
        help="folder to train from; may be given several times, and a folder given twice counts twice",
    )
    fit.add_argument("--held-out", type=Path, required=True, metavar="DIR", help="folder to validate on")
    fit.add_argument("--out", type=Path, required=True, metavar="FILE", help="function file to write (….safetensors)")
    fit.add_argument("--start-from", type=Path, metavar="FILE", help="function file whose weights are the beginning")
    fit.add_argument(
        "--checkpoint", type=Path, metavar="FILE", help="file to write on the way, and to go on from if it exists"
    )
    fit.add_argument("--weaknesses", metavar="TEXT", help="what is known to go wrong, for the function's card")
    # What is not given stays as `TrainingSettings` has it, whose defaults are shown.
    for name, kind, metavar, what in (
        ("steps", int, "N", "optimiser steps of the whole schedule"),
        ("time_budget_s", float, "SECONDS", "end the schedule after so long; the result is then not reproducible"),
        ("batch", int, "N", "samples per step"),
        ("seed", int, "N", "of the first weights, the order of frames and every crop"),
        ("learning_rate", float, "RATE", "highest of the schedule"),
        ("longest_side", int, "PIXELS", "to which the function reduces longer frames"),
        ("class_balance", float, "EXPONENT", "0 weighs all pixels alike, 1 all classes"),
        ("person_weight", float, "WEIGHT", "by which that of person pixels is multiplied"),
        ("void_weight", float, "WEIGHT", "of void pixels, for not being called persons"),
        ("precision", str, "bf16|fp32", "of the passes; weights are always fp32"),
        ("device", str, "auto|cpu|cuda", "auto is cuda where there is one"),
        ("loader_threads", int, "N", "that cut samples; the result does not depend on it"),
        ("validate_every", int, "N", "steps between validations on held-out frames"),
    ):
        default = TrainingSettings.model_fields[name].default
        shown = "none" if default is None else f"{default}"
        fit.add_argument(_option(name), dest=name, type=kind, metavar=metavar, help=f"{what} (default: {shown})")
    fit.add_argument(
        "--scales",
        type=_numbers,
        metavar="S,S,…",
        help=f"of samples, as the function sees frames (default: {','.join(map(str, CropSettings().scales))})",
    )
    fit.add_argument(
        "--keep-norm-statistics",
        action="store_const",
        const=True,
        help="batch normalisation keeps the statistics that it has; for going on from a trained network",
    )
    fit.add_argument(
        "--threads",
        type=int,
        default=1,
        metavar="N",
        help="torch's CPU threads, part of what repeats a run (default: 1)",
    )
    return parser


def _numbers(text: str) -> tuple[float, ...]:
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"not numbers with commas between them: {text}") from None


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
