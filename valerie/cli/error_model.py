"""`valerie error-model`: for planner simulations, fit the probability that each function of a run misses a person."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from valerie.cli.shell import AsJson, DataDir, Exit, RunId, say, write_output
from valerie.local.deployment import context_of, settings_of
from valerie.measures import MEASURES

if TYPE_CHECKING:
    from valerie.analysis.error_model.files import ErrorModelCard


def error_model(
    run_id: RunId,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="FOLDER",
            help="Folder for the files.",
            show_default="error-models/ next to the data folder",
        ),
    ] = None,
    threshold: Annotated[
        float | None,
        typer.Option("--threshold", help="A person with pACC below it is a miss.", show_default="that of the spec"),
    ] = None,
    given: Annotated[
        str | None,
        typer.Option(
            "--given",
            metavar="COLUMN,…",
            help="Columns that the model takes as inputs.",
            show_default=f"those of {', '.join(m.name for m in MEASURES if m.is_queried)} that the run has",
        ),
    ] = None,
    as_json: AsJson = False,
    data_dir: DataDir = None,
) -> None:
    """Fit the probability of a miss and quantiles of pACC, given distance, occlusion, size and light.

    Writes ONNX, a table and a card, and stores them for `valerie evidence export`. Each model is tested on
    held-out places. Exits with 3 if a function gets no model: too few places, or a calibration error
    above 2 %.
    """
    from valerie.analysis.error_model.files import CARD, ErrorModelCard
    from valerie.analysis.error_model.model import GIVEN
    from valerie.pipeline.evidence.error_models import make_error_models

    columns = GIVEN if given is None else tuple(name.strip() for name in given.split(","))
    with context_of(data_dir) as context:
        files = make_error_models(context, run_id, threshold=threshold, given=columns, progress=say)
    folder = out or settings_of(data_dir).data_dir.parent / "error-models" / run_id
    for name, data in files.items():
        write_output(folder / name, data)
    card = ErrorModelCard.model_validate_json(files[CARD])
    typer.echo(files[CARD].decode().rstrip() if as_json else "\n".join(_lines(card)))
    if card.refusals or any(model.file is None for model in card.models):
        raise typer.Exit(Exit.COMPLETED_WITH_FAILURES)


def _lines(card: ErrorModelCard) -> list[str]:
    """Return the card as lines of text."""
    lines = [f"a miss is a person with pACC below {card.threshold:g}"]
    for model in card.models:
        state = model.file or f"no file, since a calibration error exceeds {card.limit:.0%}"
        lines += [
            f"{model.function}: {state}",
            f"  inputs: {', '.join(column.name for column in model.columns)}; {model.rows:,} persons, {model.places:,} places",
            f"  {model.sentence}",
            f"  inside: {model.inside:.0%} of the persons at held-out places",
        ]
    lines += [f"{function}: no model; {reason}" for function, reason in card.refusals.items()]
    lines += [f"left out: {column}; {reason}" for column, reason in card.left_out.items()]
    return [*lines, card.statement]
