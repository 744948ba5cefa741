"""`valerie train`: training sets, training, and the loop from a run's weak region to a new version of a function."""

from __future__ import annotations

import shlex
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from valerie.cli import training_sets
from valerie.cli.option_documents import takes_documents
from valerie.cli.shell import AsJson, DataDir, InferenceThreads, print_json, recorded, say
from valerie.errors import InvalidInput
from valerie.local.deployment import context_of, settings_of
from valerie.local.terminal import command_name, console

if TYPE_CHECKING:
    from valerie.analysis.comparison.before_after import VersionComparison
    from valerie.perception.training.fit import TrainingProgress
    from valerie.perception.training.frame_folder import Shard
    from valerie.pipeline.retraining.retrain import Retrained
    from valerie.pipeline.retraining.weakness import Weakness
    from valerie.runs.study.retraining import RetrainSettings

app = typer.Typer(help="Train functions under test, on random frames or where a run found them weak.")
app.command()(takes_documents(training_sets.frames))
app.command()(takes_documents(training_sets.fit))

Threads = Annotated[int, typer.Option("--threads", min=1, help="torch's CPU threads.")]


@dataclass(frozen=True, slots=True)
class WeaknessOptions:
    """Options that name the run and frames in which a function was weak."""

    run: Annotated[str | None, typer.Option("--from", metavar="RUN", help="Run in which the function was weak.")] = None
    where: Annotated[
        str | None,
        typer.Option(
            "--where",
            metavar="EXPRESSION",
            help='Expression that selects the weak rows: "pacc < 0.5 and distance_m > 25".',
        ),
    ] = None
    function: Annotated[
        str | None,
        typer.Option("--function", metavar="NAME", help="One of the run's functions; optional if it has one."),
    ] = None

    def selection(self, context: typer.Context) -> tuple[str, str] | None:
        """Return run and expression; None if the command has no option at all.

        Raises:
            InvalidInput: one of the two is missing.
        """
        if self.run is None:
            sources = [context.get_parameter_source(option) for option in context.params]
            if all(source is None or source.name == "DEFAULT" for source in sources):
                return None
            raise InvalidInput(
                "this option is missing", field="--from", limit="the id of the run that found the weakness"
            )
        if self.where is None:
            raise InvalidInput(
                "this option is missing", field="--where", limit="an expression that selects rows of the run"
            )
        return self.run, self.where


@dataclass(frozen=True, slots=True)
class VersionOptions:
    """Name and file of the new version."""

    name: Annotated[
        str | None, typer.Option("--name", metavar="NAME", help="Register under this name instead of the function's.")
    ] = None
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="Also write the function file here (….safetensors).")
    ] = None

    def require_new_file(self) -> None:
        """Check the name of the file.

        Raises:
            InvalidInput: it is not that of a new function file.
        """
        if self.out is not None and self.out.suffix != ".safetensors":
            raise InvalidInput(
                "not the name of a function file", field="--out", value=str(self.out), limit="….safetensors"
            )
        if self.out is not None and self.out.exists():
            raise InvalidInput("the file exists; a version is never overwritten", field="--out", value=str(self.out))


@dataclass(frozen=True, slots=True)
class RetrainOptions:
    """Size of the training set and length of the training."""

    frames: Annotated[int, typer.Option("--frames", min=1, help="Frames to render.")] = 120
    sites: Annotated[int, typer.Option("--sites", min=1, help="Sites to spread them over.")] = 8
    broad_share: Annotated[
        float,
        typer.Option(
            "--broad-share", min=0.0, max=0.99, help="Share of the frames that are not restricted to the region."
        ),
    ] = 0.5
    anywhere: Annotated[bool, typer.Option("--anywhere", help="Restrict no frame to the region, as a control.")] = False
    steps: Annotated[int, typer.Option("--steps", min=1, help="Training steps.")] = 300
    learning_rate: Annotated[float, typer.Option("--learning-rate", help="Peak learning rate.")] = 3e-4
    batch: Annotated[int, typer.Option("--batch", min=2, help="Samples per step.")] = 8
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the training.")] = 0
    held_out_frames: Annotated[
        int, typer.Option("--held-out-frames", min=0, help="Held-out frames for the scores on the card; 0 for none.")
    ] = 20

    def settings(self) -> RetrainSettings:
        """Return them as settings.

        Raises:
            ValidationError: a setting is out of bounds.
        """
        from valerie.runs.study.retraining import RetrainSettings

        options = asdict(self)
        return RetrainSettings(targeted=not options.pop("anywhere"), **options)


@app.callback(invoke_without_command=True)
@takes_documents
def train(
    context: typer.Context,
    weak: WeaknessOptions,
    version: VersionOptions,
    training: RetrainOptions,
    processes: Annotated[int, typer.Option("--processes", min=1, help="Render processes.")] = 1,
    threads: Threads = 1,
    as_json: AsJson = False,
    data_dir: DataDir = None,
) -> None:
    """Train a new version of a function where a run found it weak, register and compare it.

    The frames are new, on sites that neither the run nor the function's training used. `train frames`
    and `train fit` train from scratch; `train compare` compares versions on a run's frames.
    """
    if context.invoked_subcommand is not None:
        return
    selection = weak.selection(context)
    if selection is None:
        typer.echo(context.get_help())
        raise typer.Exit
    run, where = selection
    version.require_new_file()
    from valerie.pipeline.functions.registry import require_free
    from valerie.pipeline.retraining.retrain import (
        TrainingResources,
        Watcher,
        register_retrained,
        retrain,
        training_folder,
    )
    from valerie.pipeline.retraining.weakness import find_weakness, functions_of

    settings = training.settings()
    with context_of(data_dir) as deployment:
        if weak.function is None and len(choices := functions_of(deployment, run)) > 1:
            raise InvalidInput(_choose_one(context, choices), field="--function")
        weakness = find_weakness(deployment, run, where, weak.function)
        name = version.name or weakness.next_name
        require_free(name)
        _say_weakness(weakness)
        trainings = settings_of(data_dir).data_dir.parent / "training"
        folder = trainings / training_folder(weakness, settings, name)
        retrained = retrain(
            weakness,
            version.out or folder / f"{name}.safetensors",
            settings,
            folder=folder,
            resources=TrainingResources(processes, threads),
            watcher=Watcher(say_site, Steps()),
        )
        with recorded(deployment, f"train {name}"):
            registered, new = register_retrained(deployment, retrained, name)
    _say_retrained(retrained, folder)
    say(f"{'registered' if new else 'registered already'} as {registered.reference}; a spec that shows both:")
    say(f"functions: [{weakness.reference}, {registered.reference}]")
    comparison = _compare(run, [weakness.function, registered.reference], where, data_dir)
    _show(comparison, as_json=as_json)


@app.command()
def compare(
    run: Annotated[str, typer.Argument(metavar="RUN", help="The run whose frames are predicted again.")],
    versions: Annotated[
        list[str],
        typer.Option(
            "--version", metavar="FUNCTION", help="NAME, NAME@DIGEST or function file; two or more, oldest first."
        ),
    ],
    where: Annotated[
        str,
        typer.Option("--where", metavar="EXPRESSION", help="Show the selected persons and their region separately."),
    ] = "",
    picture: Annotated[
        Path | None, typer.Option("--picture", metavar="FILE.png", help="Also draw the comparison.")
    ] = None,
    mixed: Annotated[
        bool, typer.Option("--mixed", help="Allow different numeric classes, to compare precisions or engines.")
    ] = False,
    threads: InferenceThreads = None,
    as_json: AsJson = False,
    data_dir: DataDir = None,
) -> None:
    """Compare versions of a function on a run's frames, side by side; nothing is rendered.

    A name in the run's spec means the version that the run used.
    """
    comparison = _compare(run, versions, where, data_dir, threads=threads, mixed=mixed)
    if picture is not None:
        from valerie.analysis.comparison.drawing import draw_comparison

        draw_comparison(comparison, picture, title=f"run {run}")
        say(f"wrote {picture}")
    _show(comparison, as_json=as_json)


def _choose_one(context: typer.Context, functions: tuple[str, ...]) -> str:
    """Return a message with one command line per function: this one with the function added."""
    arguments = [command_name(), "train"]
    for parameter in context.command.params:
        source = context.get_parameter_source(parameter.name or "")
        if source is None or source.name != "COMMANDLINE":
            continue
        value = context.params[parameter.name or ""]
        arguments += [parameter.opts[0]] if value is True else [parameter.opts[0], str(value)]
    lines = (f"  {shlex.join([*arguments, '--function', name])}" for name in functions)
    return "the run has several functions, and one is trained at a time; choose:\n" + "\n".join(lines)


def _compare(
    run: str,
    versions: list[str],
    where: str,
    data_dir: Path | None,
    *,
    threads: int | None = None,
    mixed: bool = False,
) -> VersionComparison:
    from valerie.cli.progress_lines import ProgressLines
    from valerie.pipeline.functions.references import open_reference
    from valerie.pipeline.retraining.comparison import Grouping, compare_on_run
    from valerie.pipeline.retraining.weakness import selected_region

    lines = ProgressLines("frames")
    with context_of(data_dir) as deployment:
        return compare_on_run(
            deployment,
            run,
            versions,
            open_function=lambda name: open_reference(name, context=deployment, threads=threads),
            grouping=Grouping(where, selected_region(deployment, run, where, versions[0]) if where else None),
            mixed=mixed,
            progress=lines.tell,
        )


def _show(comparison: VersionComparison, *, as_json: bool) -> None:
    if as_json:
        print_json(comparison.as_document())
        return
    from valerie.analysis.comparison.drawing import comparison_renderable

    console().print(comparison_renderable(comparison))


def _say_weakness(weakness: Weakness) -> None:
    say(f"{weakness.where}: {weakness.selected:,} of {weakness.evaluated:,} persons of {weakness.function}")
    say(f"region: {weakness.region}")


def say_site(shard: Shard) -> None:
    """Report that the frames of a site are rendered."""
    scenes = f" of {shard.drawn:,} drawn scenes" if shard.drawn is not None else ""
    say(f"site {shard.site_seed}: {len(shard.sizes)} frames{scenes}")


def _say_retrained(retrained: Retrained, folder: Path) -> None:
    first, last = retrained.site_seeds
    say(f"{retrained.frames:,} frames kept of {retrained.drawn:,} scenes drawn on sites {first}–{last} (in {folder})")
    say(
        f"wrote {retrained.file}, digest {retrained.digest[:12]}, after {retrained.steps} steps; curve: {retrained.curve}"
    )


class Steps:
    """Progress of the training, one line every few seconds."""

    def __init__(self) -> None:
        from valerie.cli.progress_lines import ProgressLines

        self._lines = ProgressLines("steps")

    def __call__(self, now: TrainingProgress) -> None:
        self._lines.tell(now.step, now.steps, now.step / max(now.elapsed_s, 1e-9), f"loss {now.loss:.3f}")
