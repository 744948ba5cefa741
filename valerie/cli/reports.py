"""Commands that write the reports of runs, and compare runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from valerie.cli.option_documents import takes_documents
from valerie.cli.shell import (
    AsJson,
    DataDir,
    ReportFile,
    RunId,
    RunIds,
    Url,
    print_json,
    require_format,
    save,
    write_output,
)
from valerie.errors import InvalidInput
from valerie.local.deployment import settings_of
from valerie.local.terminal import console

if TYPE_CHECKING:
    import pyarrow as pa

    from valerie.analysis.claims.claims import Claims
    from valerie.analysis.comparison.beside import Beside
    from valerie.pipeline.reading.reports import ReportWith


def report(
    run_ids: RunIds,
    output: ReportFile = None,
    claims: Annotated[
        Path | None,
        typer.Option("--claims", metavar="FILE", help="Also test these claims, such as examples/claims/paper.yaml."),
    ] = None,
    beside: Annotated[
        str | None,
        typer.Option(
            "--beside",
            metavar="RUN|FILE.json",
            help="Show a comparison with another run of the same scenes, such as one in Cycles, or one that `compare` wrote.",
        ),
    ] = None,
    figures: Annotated[
        Path | None,
        typer.Option(
            "--figures",
            metavar="FOLDER",
            help="Also write the numbers of its figures: a .csv and a .parquet each.",
        ),
    ] = None,
    url: Url = None,
    data_dir: DataDir = None,
) -> None:
    """Write the self-contained report of an ended run to a file, and print its path. Needs no server.

    Several runs, such as of one grid on several sites, get one report together. That of several runs, or with
    --claims, --beside or --figures, is rebuilt from the data folder. Chromium prints it if the file is FILE.pdf.
    """
    from valerie.cli.claims import read_claims
    from valerie.cli.connecting import source_of
    from valerie.cli.following import report_path

    written = len(run_ids) == 1 and (claims, beside, figures) == (None, None, None)
    if url is not None and not written:
        problem = "several runs, --claims, --beside and --figures read the data folder"
        raise InvalidInput(problem, field="--url", value=url, limit="--data-dir")
    with source_of(data_dir, url) as source:
        path = output or report_path(settings_of(data_dir), source.run(run_ids[0]).name, run_ids[0])
        if written:
            content = source.report(run_ids[0])
        else:
            statements = None if claims is None else read_claims(claims)
            rebuilt = report_with_claims(run_ids, statements, beside, data_dir)
            content = rebuilt.html.encode()
            if figures is not None:
                _write_figures(rebuilt.figures, figures)
    if path.suffix == ".pdf":
        from valerie.cli.printing import pdf_of

        content = pdf_of(content)
    typer.echo(save(content, path))


def _write_figures(tables: Mapping[str, pa.Table], folder: Path) -> None:
    from valerie.analysis.rows.table import encoded

    for name, table in tables.items():
        for suffix in ("csv", "parquet"):
            write_output(folder / f"{name}.{suffix}", encoded(table, suffix))


def report_with_claims(
    run_ids: Sequence[str], claims: Claims | None, beside: str | None, data_dir: Path | None
) -> ReportWith:
    from valerie.local.deployment import context_of
    from valerie.pipeline.reading.reports import report_with

    with context_of(data_dir) as context:
        return report_with(context, *run_ids, claims=claims, other=_comparison(beside))


def _comparison(beside: str | None) -> str | Beside | None:
    """Return the id of a run as it is, and a comparison from its file."""
    if beside is None or not beside.endswith(".json"):
        return beside
    from valerie.analysis.comparison import beside as comparison
    from valerie.local.spec_files import read_spec

    return comparison.Beside.from_json(read_spec(Path(beside)))


@dataclass(frozen=True, slots=True)
class Sides:
    """The rows of a comparison."""

    functions: Annotated[
        list[str] | None,
        typer.Option(
            "--function",
            metavar="NAME",
            help="Twice: a function of RUN, and the one of OTHER (or RUN) to compare it with.",
        ),
    ] = None
    across: Annotated[
        list[str] | None,
        typer.Option(
            "--across",
            metavar="PARAMETER",
            help="Match frames that differ in this parameter, which each run holds at a value of its own, such as "
            "sun-1.elevation of a run by day and one at dusk; may be repeated.",
        ),
    ] = None
    where: Annotated[
        str,
        typer.Option(
            "--where", metavar="EXPRESSION", help='Only rows of RUN that satisfy this expression: "distance_m > 25".'
        ),
    ] = ""


@takes_documents
def compare(
    run_id: RunId,
    sides: Sides,
    other: Annotated[
        str | None, typer.Argument(metavar="[OTHER]", help="A run of the same scenes.", show_default=False)
    ] = None,
    claims: Annotated[
        Path | None, typer.Option("--claims", metavar="FILE", help="Also test these claims on both sides.")
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE",
            help="Also write FILE.html, the report of RUN with pictures; or the "
            "differences as FILE.csv, .parquet or .json.",
        ),
    ] = None,
    as_json: AsJson = False,
    data_dir: DataDir = None,
) -> None:
    """Compare two ended runs on their shared scenes, or two functions of one run.

    Prints paired differences of pACC by slice (distance, occlusion, character,
    camera, every varied parameter), rank correlation, and which conclusions hold
    on both sides. The report shows the worst regressions.
    """
    from valerie.cli.claims import read_claims
    from valerie.cli.comparing import contents, renderables
    from valerie.cli.progress_lines import counting
    from valerie.local.deployment import context_of
    from valerie.pipeline.reading.reports import compare_runs, report_with

    pair = _function_pair(other, sides.functions or [])
    require_format(output, (".html", ".csv", ".parquet", ".json"))
    statements = None if claims is None else read_claims(claims)
    with context_of(data_dir) as context:
        comparison = compare_runs(
            context, run_id, other or run_id,
            functions=pair, claims=statements, across=sides.across or (), where=sides.where, progress=counting("frames compared"),
        )  # fmt: skip
        if output is not None and output.suffix == ".html":
            html = report_with(context, run_id, claims=statements, other=comparison).html
            write_output(output, html.encode())
    if output is not None and output.suffix != ".html":
        write_output(output, contents(comparison, output.suffix))
    if as_json:
        print_json(comparison.to_json())
        return
    for part in renderables(comparison):
        console().print(part)


def _function_pair(other: str | None, functions: list[str]) -> tuple[str, str] | None:
    """Return the functions to compare; None for all."""
    if len(functions) == 2:
        here, there = functions
        if other is None and here == there:
            raise InvalidInput("a function is compared with itself", field="--function", value=here)
        return here, there
    if functions or other is None:
        limit = "OTHER, a run of the same scenes; or --function A --function B"
        raise InvalidInput(
            "a comparison has two sides", field="--function", value=", ".join(functions) or None, limit=limit
        )
    return None
