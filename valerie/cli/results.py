"""Commands that show or export the numbers of a run. They need no server."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from valerie.cli.datasets import Where
from valerie.cli.shell import AsJson, DataDir, RunId, RunIds, require_format, say
from valerie.local.deployment import context_of
from valerie.local.terminal import console
from valerie.plain import typed

if TYPE_CHECKING:
    from valerie.pipeline.base.context import Context


def findings(run_ids: RunIds, as_json: AsJson = False, data_dir: DataDir = None) -> None:
    """Show the verdicts, the table and the findings of an ended run, or of several runs combined.

    A grid has no confidence interval. Runs of a grid on several sites (`asset: {name: …, seed: 7}`), taken
    together, have one: the sites are a sample.
    """
    from valerie.analysis.findings.findings import Findings
    from valerie.analysis.summary.summary import Summary
    from valerie.analysis.summary.text import summary_renderable
    from valerie.answers import RunSummary
    from valerie.cli.following import show_first
    from valerie.pipeline.base.run_artifacts import SUMMARY, read_artifact

    with context_of(data_dir) as context:
        text = _together(context, run_ids) if len(run_ids) > 1 else read_artifact(context, run_ids[0], SUMMARY).decode()
    if as_json:
        typer.echo(text)
        return
    results = RunSummary.model_validate_json(text)
    show_first(results)
    summary, findings = typed(Summary, results.summary), typed(Findings, results.findings)
    console().print(summary_renderable(summary, findings, most=None))


def _together(context: Context, run_ids: list[str]) -> str:
    """Return the summary and the findings of several runs, as JSON text."""
    from valerie.analysis.analyze import analyze
    from valerie.pipeline.reading.tables import read_together
    from valerie.pipeline.work.finish import summary_json

    together = read_together(context, run_ids)
    say_differing(together.differing)
    spec = together.runs[0].resolved.spec
    return summary_json(analyze(together.table, threshold=spec.detection_threshold, seed=spec.seed), ()).decode()


def say_differing(texts: Sequence[str]) -> None:
    """Name the differences, besides the site or the draw, between runs that are taken together."""
    if texts:
        say(f"No finding accounts for what differs: {'; '.join(texts)}.")


def rows(
    run_id: RunId,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="FILE", help="FILE.csv or FILE.parquet; by default standard output."),
    ] = None,
    where: Where = "",
    data_dir: DataDir = None,
) -> None:
    """Write the long table of a run: one row per person in each evaluation that is done."""
    import io

    import numpy as np

    from valerie.db.archives import reading_run
    from valerie.pipeline.base.resolved_runs import read_run
    from valerie.pipeline.reading.selection import evaluated_persons, run_where
    from valerie.pipeline.reading.tables import read_table

    require_format(output, (".csv", ".parquet"))
    with context_of(data_dir) as context:
        run = read_run(context, run_id)
        table = read_table(context.engine, run)
        if where:
            expression = run_where(where, run.resolved, field="--where")
            with reading_run(context.engine, run_id) as connection:
                selected = [expression.holds(person.row) for person in evaluated_persons(connection, run)]
            # A running run may have more rows by now.
            table = table.select(np.array(selected[: len(table)], np.bool_))
    if output is None:
        buffer = io.BytesIO()
        table.to_csv(buffer)
        typer.echo(buffer.getvalue().decode(), nl=False)
        return
    (table.to_csv if output.suffix == ".csv" else table.to_parquet)(output)
    say(f"{output}: {len(table):,} rows")
