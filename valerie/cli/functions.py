"""Commands about functions under test: import, list, show, export and remove them."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from valerie.cli.registering import import_file, open_registry, register_file
from valerie.cli.shell import AsJson, DataDir, InferenceThreads, Url, print_json, recorded, say, write_output
from valerie.errors import InvalidInput
from valerie.local.deployment import settings_of
from valerie.local.terminal import command_name, console

if TYPE_CHECKING:
    from valerie.answers import Function, NoTrial, Trial
    from valerie.metrics.collection import CollectionScores

#: Most predicted classes that are listed for a true one.
_MOST_CLASSES: Final = 4
#: Characters of a digest that identify a version, as in `valerie.db.functions`.
_SHORT: Final = 12

app = typer.Typer(no_args_is_help=True, help="Register, list, show and remove functions under test.")

Reference = Annotated[
    str, typer.Argument(metavar="NAME[@DIGEST]", help="A function; without a digest its newest version.")
]


@app.command("import")
def import_(
    file: Annotated[
        Path | None,
        typer.Argument(
            metavar="[FILE]", help="Checkpoint (.pth, .pkl, .safetensors), .onnx, or a Hugging Face folder."
        ),
    ] = None,
    name: Annotated[str | None, typer.Option("--name", metavar="NAME", help="Name of the function in specs.")] = None,
    document: Annotated[
        Path | None,
        typer.Option(
            "--document",
            metavar="SIDE.yaml",
            help="Facts that the file does not state: classes, input, class map; by default FILE's name with .yaml.",
        ),
    ] = None,
    engine: Annotated[
        str | None, typer.Option("--engine", metavar="ENGINE", help="torch, openvino or onnxruntime.")
    ] = None,
    precision: Annotated[
        str | None, typer.Option("--precision", metavar="PRECISION", help="fp32 (the reference), bf16, fp16, or int8.")
    ] = None,
    as_json: AsJson = False,
    url: Url = None,
    data_dir: DataDir = None,
) -> None:
    """Convert, check and register a function under test.

    Nothing in the file is run. The import happens here, or in the server that runs on the
    data folder. Functions behind HTTP and uploaded predictions need only a document.
    """
    if file is None and document is None:
        raise InvalidInput("nothing to import", field="FILE", limit="a file, or --document SIDE.yaml, or both")
    options = {"name": name, "engine": engine, "precision": precision}
    texts = {field: value for field, value in options.items() if value is not None}
    settings = settings_of(data_dir)
    opening = partial(open_registry, settings, url, create=True)
    registered, new = register_file(opening, file, document=document, **texts)
    if as_json:
        print_json({**registered.as_json(), "new": new})
        return
    _card(registered)
    say(("registered" if new else "registered already") + f" as {registered.reference}; in a spec:")
    typer.echo(f"functions: [{registered.name}]")
    say(f"runs that start from now on pin this version; try it with: {command_name()} run SPEC")


@app.command("try")
def try_(
    file: Annotated[
        Path, typer.Argument(metavar="FILE", help="As for `import`; a document beside the file is read, too.")
    ],
    document: Annotated[
        Path | None, typer.Option("--document", metavar="SIDE.yaml", help="Facts that the file does not state.")
    ] = None,
    spec: Annotated[
        Path | None,
        typer.Option("--spec", metavar="SPEC", help="Spec of the frames; by default the one of `valerie new`."),
    ] = None,
    count: Annotated[int, typer.Option("--frames", min=1, max=50, help="Number of frames.")] = 3,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FILE", help="Picture to write; by default FILE-try.png.")
    ] = None,
    data_dir: DataDir = None,
) -> None:
    """Let a function predict on a few frames, without registering it.

    Writes a picture with a row for each frame: the picture, the network's input, the predicted and the true classes,
    and the errors on persons. Prints the confusion of all frames.
    """
    from tempfile import TemporaryDirectory

    from valerie.document import template
    from valerie.local.spec_files import read_spec
    from valerie.metrics.collection import collection_scores
    from valerie.pipeline.reading.painting import png
    from valerie.pipeline.work.trying import contact_sheet, render_frames, try_function
    from valerie.runs.resolving.spec import parse

    settings = settings_of(data_dir)
    run_spec = parse(template("valerie.runs") if spec is None else read_spec(spec))
    with TemporaryDirectory(prefix="valerie-try-") as folder:
        imported = import_file(file, Path(folder), settings, document=document)
        frames = render_frames(run_spec, settings, count)
        card, trials = try_function(imported.document, imported.payload, frames, settings)
    _rows(card)
    _show_scores(collection_scores([frame.confusion for frame in trials]))
    path = output or Path(f"{file.absolute().stem}-try.png")
    write_output(path, png(contact_sheet(trials)))


@app.command()
def quantize(
    function: Annotated[str, typer.Argument(metavar="FUNCTION", help="One of the run's functions.")],
    run: Annotated[str, typer.Option("--from", metavar="RUN", help="Run whose frames calibrate the ranges of values.")],
    name: Annotated[
        str | None, typer.Option("--name", metavar="NAME", help="Register under this name instead of FUNCTION-int8.")
    ] = None,
    frames: Annotated[int, typer.Option("--frames", min=1, help="Number of calibration frames.")] = 32,
    threads: InferenceThreads = None,
    as_json: AsJson = False,
    data_dir: DataDir = None,
) -> None:
    """Register an int8 version of a function, and compare both on the run's frames.

    The card states the change of pACC. Nothing is rendered.
    """
    from valerie.analysis.comparison.drawing import comparison_renderable
    from valerie.cli.progress_lines import ProgressLines
    from valerie.local.deployment import context_of
    from valerie.pipeline.retraining.quantization import quantize_function

    lines = ProgressLines("frames")
    with context_of(data_dir) as deployment, recorded(deployment, f"function quantize {function}"):
        model = quantize_function(
            deployment,
            run,
            function,
            name or f"{function.partition('@')[0]}-int8",
            frames=frames,
            threads=threads,
            progress=lines.tell,
        )
    if as_json:
        print_json(model.comparison.as_document())
    else:
        console().print(comparison_renderable(model.comparison))
    say(f"{'registered' if model.new else 'registered already'} as {model.registered.reference}; in a spec:")
    say(f"functions: [{model.registered.name}]")


@app.command("list")
def list_(as_json: AsJson = False, url: Url = None, data_dir: DataDir = None) -> None:
    """List the functions that a spec may name, every version of registered ones."""
    with open_registry(settings_of(data_dir), url) as registry:
        functions = registry.functions()
    if as_json:
        print_json([function.as_json() for function in functions], indent=1)
        return
    from rich.table import Table

    table = Table(box=None, pad_edge=False, header_style="dim")
    for column in ("name", "version", "digest", "kind", "architecture", "engine", "offered"):
        table.add_column(column, no_wrap=column in ("name", "version", "digest"))
    for function in functions:
        offered = function.problem or ("yes" if function.numeric_classes else "no living worker")
        if function.kind == "predictions":
            offered = "by their uploader"
        version = "installed" if function.version is None else str(function.version)
        engine = "" if function.engine in ("", "none") else f"{function.engine} {function.precision}"
        digest = function.digest[:_SHORT]
        table.add_row(function.name, version, digest, function.kind or "", function.architecture, engine, offered)
    console().print(table)


@app.command()
def show(reference: Reference, as_json: AsJson = False, url: Url = None, data_dir: DataDir = None) -> None:
    """Show the card of a function."""
    with open_registry(settings_of(data_dir), url) as registry:
        function = registry.function(reference)
    if as_json:
        print_json(function.as_json(), indent=1)
        return
    _card(function)


@app.command()
def export(
    reference: Reference,
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder to write into; created if missing.")],
    url: Url = None,
    data_dir: DataDir = None,
) -> None:
    """Write a registered function as document and file, for `valerie function import`."""
    import yaml

    with open_registry(settings_of(data_dir), url) as registry:
        function = registry.function(reference)
        document = function.document
        if document is None or function.reference is None:
            raise InvalidInput("an installed function has no document in the registry", field="NAME", value=reference)
        data = None if document.payload is None else registry.function_payload(function.reference)
    name = document.name
    try:
        folder.mkdir(parents=True, exist_ok=True)
        files = [folder / f"{name}.yaml"]
        with files[0].open("x", encoding="utf-8") as stream:
            yaml.safe_dump(
                document.model_dump(mode="json", exclude_unset=True), stream, sort_keys=False, allow_unicode=True
            )
        if data is not None and document.payload is not None:
            files.append(folder / f"{name}.{document.payload.format}")
            with files[1].open("xb") as target:
                target.write(data)
    except FileExistsError as error:
        raise InvalidInput("the file exists", value=str(error.filename)) from None
    except OSError as error:
        raise InvalidInput(f"the folder cannot be written ({error.strerror})", value=str(folder)) from error
    for path in files:
        typer.echo(path)


@app.command()
def remove(
    reference: Annotated[str, typer.Argument(metavar="NAME@DIGEST", help="One version; `list` shows them.")],
    url: Url = None,
    data_dir: DataDir = None,
) -> None:
    """Remove one version of a registered function that no unfinished run needs."""
    with open_registry(settings_of(data_dir), url) as registry:
        registry.remove_function(reference)
    say(f"{reference} is removed; its results stay")


def _card(function: Function) -> None:
    _rows(
        [
            ("name", function.name),
            ("version", "" if function.version is None else f"{function.version}  ({function.reference})"),
            *function.card,
            ("tried out", _trial_text(function.check)),
            ("offered as", ", ".join(function.numeric_classes)),
            ("problem", function.problem),
        ]
    )


def _rows(rows: Iterable[tuple[str, str | None]]) -> None:
    """Print titles with their texts, if they have one."""
    from rich.table import Table
    from rich.text import Text

    table = Table.grid(padding=(0, 2))
    table.add_column(style="dim", no_wrap=True)
    table.add_column(overflow="fold")
    for title, text in rows:
        if text:
            table.add_row(title, Text(text))
    console().print(table)


def _show_scores(scores: CollectionScores) -> None:
    """Print the classes in the truth with their shares of predicted classes, the person first."""
    from rich.table import Table

    from valerie.labels import PERSON, TRAIN_NAMES

    names = list(TRAIN_NAMES.values())
    table = Table(box=None, pad_edge=False, header_style="dim")
    for column in ("class", "pixels", "pACC", "precision", "predicted as"):
        table.add_column(column, justify="left" if column in ("class", "predicted as") else "right")
    for part in sorted(scores.classes, key=lambda part: (part.label != PERSON, part.label.train_id)):
        counts = scores.matrix[part.label.train_id]
        if total := int(counts.sum()):
            largest = [index for index in counts.argsort()[::-1][:_MOST_CLASSES].tolist() if counts[index]]
            shares = ", ".join(f"{names[index]} {100 * counts[index] / total:.1f} %" for index in largest)
            scored = (
                "" if value is None else f"{100 * value:.1f}" for value in (part.pacc.pooled, part.precision.pooled)
            )
            table.add_row(part.label.name, f"{total:,}", *scored, shares)
    console().print(table)


def _trial_text(check: Trial | NoTrial | None) -> str:
    from valerie.answers import NoTrial

    if check is None:
        return ""
    if isinstance(check, NoTrial):
        return f"not here: {check.skipped}"
    width, height = check.picture
    return f"runs: {check.numeric_class}, {check.cpu_seconds:g} CPU seconds for {width} × {height}"
