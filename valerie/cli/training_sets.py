"""`valerie train frames` and `valerie train fit`: render training sets, and train networks on them."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from valerie.errors import InvalidInput, InvalidInputs

if TYPE_CHECKING:
    from valerie.perception.training.fit import TrainingProgress
    from valerie.perception.training.frame_folder import Shard

#: Settings to the parameters that set them, if the names differ.
_PARAMETERS: Final = {"time_budget_s": "time_budget", "crops": "scales", "width": "size", "height": "size"}
#: Steps between two lines of progress.
_STEPS_PER_LINE: Final = 50


def frames(
    context: typer.Context,
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Empty folder to render into.")],
    split: Annotated[str, typer.Option("--split", metavar="train|held-out", help="Which sites.")] = "train",
    first_seed: Annotated[
        int | None, typer.Option("--first-seed", help="First site seed.", show_default="the split's first")
    ] = None,
    sites: Annotated[int, typer.Option("--sites", help="Number of sites.")] = 100,
    per_site: Annotated[int, typer.Option("--per-site", help="Frames of each site.")] = 30,
    size: Annotated[str, typer.Option("--size", metavar="WxH", help="Size of the frames, pixels.")] = "960x540",
    processes: Annotated[int, typer.Option("--processes", min=1, help="Processes that render.")] = 1,
    asset: Annotated[
        str | None,
        typer.Option(
            "--asset",
            metavar="NAME",
            help="Generated asset that takes a seed.",
            show_default="the first installed pack",
        ),
    ] = None,
) -> None:
    """Render a training set into an empty folder: of sites whose seeds no run uses by default."""
    from valerie.pipeline.retraining.training_frames import FrameSettings, render_training_frames

    width, height = _size(size)
    with _named_by_option(context):
        settings = FrameSettings.model_validate(
            {
                "split": split,
                "first_seed": first_seed,
                "sites": sites,
                "per_site": per_site,
                "width": width,
                "height": height,
                **({} if asset is None else {"asset": asset}),
            }
        )
        started, done = time.monotonic(), 0

        def tell(shard: Shard) -> None:
            nonlocal done
            done += 1
            rate = done * settings.per_site / (time.monotonic() - started)
            typer.echo(f"site {shard.site_seed}: {done}/{settings.sites} sites, {rate:.1f} frames/s")

        rendered = render_training_frames(folder, settings, processes=processes, progress=tell)
    typer.echo(f"{len(rendered)} frames in {folder}, digest {rendered.digest}")


def fit(
    context: typer.Context,
    architecture: Annotated[
        str, typer.Argument(metavar="ARCHITECTURE", help="semantic-fpn-small, deeplabv3plus-small, …")
    ],
    frames: Annotated[
        list[Path],
        typer.Option("--frames", metavar="DIR", help="Folder to train on; can be repeated, and twice counts twice."),
    ],
    held_out: Annotated[Path, typer.Option("--held-out", metavar="DIR", help="Folder to validate on.")],
    out: Annotated[Path, typer.Option("--out", metavar="FILE", help="Function file to write (….safetensors).")],
    start_from: Annotated[
        Path | None, typer.Option("--start-from", metavar="FILE", help="Function file with the first weights.")
    ] = None,
    checkpoint: Annotated[
        Path | None, typer.Option("--checkpoint", metavar="FILE", help="Written on the way; resumed if it exists.")
    ] = None,
    weaknesses: Annotated[
        str | None, typer.Option("--weaknesses", metavar="TEXT", help="Known weaknesses, for the function's card.")
    ] = None,
    steps: Annotated[int, typer.Option("--steps", help="Optimiser steps of the whole schedule.")] = 6000,
    time_budget: Annotated[
        float | None,
        typer.Option("--time-budget", metavar="SECONDS", help="End the schedule after this time; not repeatable."),
    ] = None,
    batch: Annotated[int, typer.Option("--batch", help="Samples per step.")] = 16,
    seed: Annotated[int, typer.Option("--seed", help="Seed of weights, order of frames and crops.")] = 0,
    learning_rate: Annotated[float, typer.Option("--learning-rate", help="Highest of the schedule.")] = 2e-3,
    longest_side: Annotated[
        int | None, typer.Option("--longest-side", metavar="PIXELS", help="The function reduces longer frames to it.")
    ] = None,
    class_balance: Annotated[
        float, typer.Option("--class-balance", metavar="EXPONENT", help="0 weighs all pixels alike, 1 all classes.")
    ] = 0.0,
    person_weight: Annotated[float, typer.Option("--person-weight", help="Factor of person pixels.")] = 3.0,
    void_weight: Annotated[
        float, typer.Option("--void-weight", help="Weight of the loss for void pixels predicted as persons.")
    ] = 0.0,
    scales: Annotated[
        str, typer.Option("--scales", metavar="S,S,…", help="Scales of samples, as the function sees frames.")
    ] = "1.0,0.5",
    keep_norm_statistics: Annotated[
        bool,
        typer.Option("--keep-norm-statistics", help="Keep batch normalisation's statistics; use with --start-from."),
    ] = False,
    precision: Annotated[
        str,
        typer.Option(
            "--precision", metavar="auto|bf16|fp32", help="Precision of the passes; auto is bf16 where it is fast."
        ),
    ] = "auto",
    device: Annotated[
        str, typer.Option("--device", metavar="auto|cpu|cuda", help="auto is cuda if available.")
    ] = "auto",
    loader_threads: Annotated[
        int, typer.Option("--loader-threads", help="Threads that cut samples; no effect on the result.")
    ] = 4,
    validate_every: Annotated[
        int, typer.Option("--validate-every", help="Steps between validations on held-out frames.")
    ] = 1000,
    threads: Annotated[int, typer.Option("--threads", min=1, help="torch's CPU threads; they affect the result.")] = 1,
) -> None:
    """Train one network on folders of frames and write it as a function file."""
    from valerie.perception.training.curve import TrainingCurve
    from valerie.perception.training.fit import train
    from valerie.perception.training.frame_folder import FrameFolder
    from valerie.perception.training.provenance import training_provenance
    from valerie.perception.training.settings import TrainingSettings
    from valerie.perception.training.training_set import open_training_set

    with _named_by_option(context):
        settings = TrainingSettings.model_validate(
            {
                "architecture": architecture,
                "seed": seed,
                "steps": steps,
                "time_budget_s": time_budget,
                "batch": batch,
                "longest_side": longest_side,
                "class_balance": class_balance,
                "person_weight": person_weight,
                "void_weight": void_weight,
                "learning_rate": learning_rate,
                "keep_norm_statistics": keep_norm_statistics,
                "precision": precision,
                "device": device,
                "loader_threads": loader_threads,
                "validate_every": validate_every,
                "crops": {"scales": _numbers(scales)},
            }
        )
        training_set, validation_set = open_training_set(frames), FrameFolder(held_out)
        curve_file = out.with_suffix(".curve.json")
        if checkpoint is None or not checkpoint.exists():
            curve_file.unlink(missing_ok=True)
        curve = TrainingCurve(curve_file)

        def tell(now: TrainingProgress) -> None:
            curve(now)
            if now.step % _STEPS_PER_LINE == 0 or now.figures is not None:
                typer.echo(f"step {now.step} ({now.fraction:.1%}), loss {now.loss:.4f}, {now.elapsed_s:.0f} s")
            if now.figures is not None:
                typer.echo(f"  held out: {now.figures.as_text()}")

        model = train(
            settings,
            training_set,
            held_out=validation_set,
            progress=tell,
            checkpoint=checkpoint,
            start_from=start_from,
            threads=threads,
        )
        provenance = training_provenance(training_set, validation_set, start_from)
    provenance["trained-by"] = "valerie train fit"
    if weaknesses:
        provenance["known-weaknesses"] = weaknesses
    data = model.to_bytes(provenance)
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_bytes(data)
    typer.echo(f"{out}: {len(data) / 1e6:.2f} MB after {model.steps} steps")
    if model.figures is not None:
        typer.echo(f"held out: {model.figures.as_text()}")
    typer.echo(f"curve: {curve.finish(model.steps, model.figures, title=f'{out.stem}, {len(training_set)} frames')}")


@contextmanager
def _named_by_option(context: typer.Context) -> Iterator[None]:
    """Make errors name a setting's option instead of the setting."""
    from pydantic import ValidationError

    from valerie.validation import problem_of

    options = {
        str(parameter.name): parameter.opts[0]
        if isinstance(parameter, typer.core.TyperOption)
        else str(parameter.metavar)
        for parameter in context.command.params
    }
    options |= {setting: options[name] for setting, name in _PARAMETERS.items() if name in options}
    try:
        yield
    except ValidationError as error:
        raise InvalidInputs([problem_of(detail, options[str(detail["loc"][0])]) for detail in error.errors()]) from None
    except InvalidInput as error:
        if type(error) is InvalidInput and error.field in options:
            raise InvalidInput(
                error.message, field=options[error.field], value=error.value, limit=error.limit
            ) from None
        raise


def _numbers(text: str) -> tuple[float, ...]:
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError:
        raise InvalidInput("not numbers with commas between them", field="--scales", value=text) from None


def _size(text: str) -> tuple[int, int]:
    width, _, height = text.partition("x")
    try:
        return int(width), int(height)
    except ValueError:
        raise InvalidInput("not a size", field="--size", value=text, limit="WIDTHxHEIGHT") from None
