"""`valerie train frames` and `valerie train fit`: render training sets, and train networks on them."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from valerie.errors import InvalidInput, InvalidInputs

if TYPE_CHECKING:
    from valerie.perception.training.curve import TrainingCurve
    from valerie.perception.training.fit import TrainingProgress
    from valerie.perception.training.frame_folder import Shard
    from valerie.perception.training.training_settings import TrainingSettings
    from valerie.pipeline.retraining.training_frames import FrameSettings

#: Settings to the parameters that set them, if the names differ.
_PARAMETERS: Final = {"time_budget_s": "time_budget", "crops": "scales", "width": "size", "height": "size"}
#: Steps between two lines of progress.
_STEPS_PER_LINE: Final = 50


@dataclass(frozen=True, slots=True)
class FrameOptions:
    """The frames of a training set."""

    split: Annotated[str, typer.Option("--split", metavar="train|held-out", help="Sites to render.")] = "train"
    first_seed: Annotated[
        int | None, typer.Option("--first-seed", help="First site seed.", show_default="the split's first")
    ] = None
    sites: Annotated[int, typer.Option("--sites", help="Number of sites.")] = 100
    per_site: Annotated[int, typer.Option("--per-site", help="Frames of each site.")] = 30
    size: Annotated[str, typer.Option("--size", metavar="WxH", help="Size of the frames, pixels.")] = "960x540"
    asset: Annotated[
        str | None,
        typer.Option(
            "--asset",
            metavar="NAME",
            help="Generated asset that takes a seed.",
            show_default="the first installed pack",
        ),
    ] = None

    def settings(self) -> FrameSettings:
        """Return them as settings.

        Raises:
            InvalidInput, ValidationError: a setting is out of bounds.
        """
        from valerie.pipeline.retraining.training_frames import FrameSettings

        options = asdict(self)
        options["width"], options["height"] = _size(options.pop("size"))
        if self.asset is None:
            del options["asset"]
        return FrameSettings.model_validate(options)


def frames(
    context: typer.Context,
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Empty folder to render into.")],
    options: FrameOptions,
    processes: Annotated[int, typer.Option("--processes", min=1, help="Render processes.")] = 1,
) -> None:
    """Render a training set into an empty folder, of sites that runs do not use by default."""
    from valerie.pipeline.retraining.training_frames import render_training_frames

    with _named_by_option(context):
        settings = options.settings()
        started, done = time.monotonic(), 0

        def tell(shard: Shard) -> None:
            nonlocal done
            done += 1
            rate = done * settings.per_site / (time.monotonic() - started)
            typer.echo(f"site {shard.site_seed}: {done}/{settings.sites} sites, {rate:.1f} frames/s")

        rendered = render_training_frames(folder, settings, processes=processes, progress=tell)
    typer.echo(f"{len(rendered)} frames in {folder}, digest {rendered.digest}")


@dataclass(frozen=True, slots=True)
class FitFiles:
    """The files of a training."""

    frames: Annotated[
        list[Path],
        typer.Option("--frames", metavar="DIR", help="Folder to train on; may be repeated, also to count it twice."),
    ]
    held_out: Annotated[Path, typer.Option("--held-out", metavar="DIR", help="Folder to validate on.")]
    out: Annotated[Path, typer.Option("--out", metavar="FILE", help="Function file to write (….safetensors).")]
    start_from: Annotated[
        Path | None, typer.Option("--start-from", metavar="FILE", help="Function file with the initial weights.")
    ] = None
    checkpoint: Annotated[
        Path | None,
        typer.Option(
            "--checkpoint", metavar="FILE", help="Checkpoint to write; training resumes from it if it exists."
        ),
    ] = None

    def new_curve(self) -> TrainingCurve:
        """Return the curve beside the function file, without the points of an earlier training."""
        from valerie.perception.training.curve import TrainingCurve

        path = self.out.with_suffix(".curve.json")
        if self.checkpoint is None or not self.checkpoint.exists():
            path.unlink(missing_ok=True)
        return TrainingCurve(path)


@dataclass(frozen=True, slots=True)
class FitOptions:
    """The settings of a training."""

    steps: Annotated[int, typer.Option("--steps", help="Optimiser steps of the whole schedule.")] = 6000
    time_budget: Annotated[
        float | None,
        typer.Option("--time-budget", metavar="SECONDS", help="End the schedule after this time; not repeatable."),
    ] = None
    batch: Annotated[int, typer.Option("--batch", help="Samples per step.")] = 16
    seed: Annotated[int, typer.Option("--seed", help="Seed of weights, order of frames and crops.")] = 0
    learning_rate: Annotated[float, typer.Option("--learning-rate", help="Peak learning rate.")] = 2e-3
    longest_side: Annotated[
        int | None,
        typer.Option("--longest-side", metavar="PIXELS", help="Longest side; the function shrinks larger frames."),
    ] = None
    class_balance: Annotated[
        float, typer.Option("--class-balance", metavar="EXPONENT", help="0 weights all pixels equally, 1 all classes.")
    ] = 0.0
    person_weight: Annotated[float, typer.Option("--person-weight", help="Weight of person pixels in the loss.")] = 3.0
    void_weight: Annotated[
        float, typer.Option("--void-weight", help="Weight in the loss of void pixels predicted as persons.")
    ] = 0.0
    scales: Annotated[
        str, typer.Option("--scales", metavar="S,S,…", help="Scales of the samples, relative to the function's input.")
    ] = "1.0,0.5"
    keep_norm_statistics: Annotated[
        bool,
        typer.Option("--keep-norm-statistics", help="Keep batch normalisation's statistics; use with --start-from."),
    ] = False
    precision: Annotated[
        str,
        typer.Option(
            "--precision", metavar="auto|bf16|fp32", help="Precision of the passes; auto is bf16 where it is fast."
        ),
    ] = "auto"
    device: Annotated[str, typer.Option("--device", metavar="auto|cpu|cuda", help="auto is cuda if available.")] = (
        "auto"
    )
    loader_threads: Annotated[
        int, typer.Option("--loader-threads", help="Threads that prepare samples; they do not affect the result.")
    ] = 4
    validate_every: Annotated[
        int, typer.Option("--validate-every", help="Steps between validations on held-out frames.")
    ] = 1000

    def settings(self, architecture: str) -> TrainingSettings:
        """Return them as settings.

        Raises:
            InvalidInput, ValidationError: a setting is out of bounds.
        """
        from valerie.perception.training.training_settings import TrainingSettings

        options = asdict(self)
        options["time_budget_s"] = options.pop("time_budget")
        options["crops"] = {"scales": _numbers(options.pop("scales"))}
        return TrainingSettings.model_validate({"architecture": architecture, **options})


def fit(
    context: typer.Context,
    architecture: Annotated[
        str, typer.Argument(metavar="ARCHITECTURE", help="semantic-fpn-small, deeplabv3plus-small, …")
    ],
    files: FitFiles,
    weaknesses: Annotated[
        str | None, typer.Option("--weaknesses", metavar="TEXT", help="Known weaknesses, for the function's card.")
    ] = None,
    *,
    options: FitOptions,
    threads: Annotated[int, typer.Option("--threads", min=1, help="torch's CPU threads; they affect the result.")] = 1,
) -> None:
    """Train one network on folders of frames and write it as a function file."""
    from valerie.perception.training.fit import train
    from valerie.perception.training.frame_folder import FrameFolder
    from valerie.perception.training.provenance import training_provenance
    from valerie.perception.training.training_set import open_training_set

    with _named_by_option(context):
        settings = options.settings(architecture)
        training_set, validation_set = open_training_set(files.frames), FrameFolder(files.held_out)
        curve = files.new_curve()

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
            checkpoint=files.checkpoint,
            start_from=files.start_from,
            threads=threads,
        )
        provenance = training_provenance(training_set, validation_set, files.start_from)
    provenance["trained-by"] = "valerie train fit"
    if weaknesses:
        provenance["known-weaknesses"] = weaknesses
    data, out = model.to_bytes(provenance), files.out
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
