"""The command line: all commands, in the order in which a new user needs them."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from valerie.cli import (
    assets,
    claims,
    datasets,
    error_model,
    evaluation,
    evidence,
    frames,
    functions,
    gate,
    machine,
    marks,
    predictions,
    reports,
    results,
    runs,
    slurm,
    specs,
    studies,
    tokens,
    training,
)
from valerie.cli.shell import guarded

_HELP = """Validation of perception DNNs of automated vehicles by systematic variation of synthetic scenes.

\b
First steps:
  valerie new first.yaml       write a commented spec
  valerie plan first.yaml      show what it would cost
  valerie run first.yaml       run it on this machine, show the table, write the report
  valerie up                   server and dashboard, until Ctrl-C

\b
Exit codes:
  0         done; the run completed
  1         a bug in VALERIE
  2         wrong usage or input
  3         completed, but some products failed for good; a replayed frame differs; evidence or an error model is refused
  4         the run was cancelled or failed
  5         something on this machine is missing, full or unreachable
  6         `gate`, `study run --retrain`: a requirement is not met or undecided, a function is worse than the baseline,
            or places are too few to tell
  124       a function took longer than VALERIE_INFER_SECONDS
  130, 143  interrupted (Ctrl-C), terminated

Settings are environment variables (VALERIE_…); docs/operations.md lists them."""

app = typer.Typer(
    name="valerie",
    help=_HELP,
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110},
)

_RUN, _WATCH, _PARTS = "Specs and runs", "Follow and control runs", "Parts and machines"
app.command(rich_help_panel=_RUN)(specs.new)
app.command(rich_help_panel=_RUN)(specs.plan)
app.command(rich_help_panel=_RUN)(runs.run)
app.command(rich_help_panel=_RUN)(runs.up)
app.command(rich_help_panel=_RUN)(runs.submit)
app.add_typer(studies.app, name="study", rich_help_panel=_RUN)
app.command(rich_help_panel=_RUN)(studies.refine)
app.command(rich_help_panel=_WATCH)(runs.status)
app.command(rich_help_panel=_WATCH)(reports.report)
app.command(rich_help_panel=_WATCH)(reports.compare)
app.command(rich_help_panel=_WATCH)(results.findings)
app.command(rich_help_panel=_WATCH)(results.rows)
app.command(rich_help_panel=_WATCH)(gate.gate)
app.command(rich_help_panel=_WATCH)(claims.claims)
app.command("error-model", rich_help_panel=_WATCH)(error_model.error_model)
app.command(rich_help_panel=_WATCH)(runs.cancel)
app.command(rich_help_panel=_WATCH)(runs.resume)
app.command(rich_help_panel=_WATCH)(runs.retry)
app.command(rich_help_panel=_WATCH)(runs.delete)
app.command(rich_help_panel=_WATCH)(marks.mark)
app.command(rich_help_panel=_WATCH)(machine.replay)
app.command(rich_help_panel=_PARTS)(evaluation.evaluate)
app.add_typer(datasets.app, name="dataset", rich_help_panel=_PARTS)
app.add_typer(evidence.app, name="evidence", rich_help_panel=_PARTS)
app.add_typer(assets.app, name="asset", rich_help_panel=_PARTS)
app.add_typer(functions.app, name="function", rich_help_panel=_PARTS)
app.add_typer(frames.frames_app, name="frames", rich_help_panel=_PARTS)
app.add_typer(predictions.predictions_app, name="predictions", rich_help_panel=_PARTS)
app.command(rich_help_panel=_PARTS)(machine.worker)
app.add_typer(slurm.app, name="slurm", rich_help_panel=_PARTS)
app.add_typer(training.app, name="train", rich_help_panel=_PARTS)
app.add_typer(tokens.app, name="token", rich_help_panel=_PARTS)
app.command(rich_help_panel=_PARTS)(tokens.quota)
app.command(rich_help_panel=_PARTS)(machine.doctor)
app.command(rich_help_panel=_PARTS)(machine.gc)
app.command(rich_help_panel=_PARTS)(machine.archive)
app.command(rich_help_panel=_PARTS)(machine.audit)
app.command(rich_help_panel=_PARTS)(machine.copy)
app.command(rich_help_panel=_PARTS)(machine.backup)
app.command(rich_help_panel=_PARTS)(machine.restore)
app.command(rich_help_panel=_PARTS)(machine.migrate)


def _print_version(requested: bool) -> None:
    if requested:
        from valerie.pipeline.base.environment import software

        typer.echo(software())
        raise typer.Exit


@app.callback()
def options(
    debug: Annotated[  # handled by `main`, before anything can fail
        bool, typer.Option("--debug", help="Show stack traces.")
    ] = False,
    version: Annotated[  # handled by its callback
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    """Declare the options of all commands."""


def main() -> None:
    """Run the ``valerie`` command."""
    debug = "--debug" in sys.argv
    arguments = [argument for argument in sys.argv[1:] if argument != "--debug"]
    guarded(lambda: app(args=arguments, prog_name="valerie"), debug=debug)


if __name__ == "__main__":
    main()
