"""`valerie claims`: test the claims of a paper or a data sheet on a run."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from valerie.cli.gate import run_reader
from valerie.cli.results import say_differing
from valerie.cli.shell import AsJson, DataDir, RunIds, UrlOrFolder, print_json, require_format, write_output
from valerie.errors import InvalidInput
from valerie.local.deployment import context_of
from valerie.local.spec_files import read_spec
from valerie.local.terminal import console

if TYPE_CHECKING:
    from valerie.analysis.claims.claims import Claims
    from valerie.analysis.claims.ledger import LedgerEntry

#: Formats of the ledger, by file suffix.
_FORMATS = (".csv", ".parquet", ".json", ".md")


def claims(
    run_ids: RunIds,
    document: Annotated[Path, typer.Argument(metavar="FILE", help="Claims, such as examples/claims/paper.yaml.")],
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="FILE", help="Also write the ledger: FILE.csv, .parquet, .json or .md."),
    ] = None,
    as_json: AsJson = False,
    url: UrlOrFolder = None,
    data_dir: DataDir = None,
) -> None:
    """Test the claims of a document on an ended run, or on several runs combined, such as of one grid on several sites.

    Every claim is answered: reproduced, not reproduced, undecided, or not
    testable here, with the quantity and its interval.
    """
    require_format(output, _FORMATS)
    from valerie.analysis.claims.ledger import write_ledger
    from valerie.pipeline.reading.tables import read_together

    statements = read_claims(document)
    if len(run_ids) == 1:
        run = run_reader(url, data_dir)(run_ids[0])
        table, seed = run.table, run.spec.seed
    else:
        if url is not None:
            raise InvalidInput(
                "several runs are read from the data folder", field="--url", value=url, limit="--data-dir"
            )
        with context_of(data_dir) as context:
            together = read_together(context, run_ids)
        say_differing(together.differing)
        table, seed = together.table, together.runs[0].resolved.spec.seed
    entries = write_ledger(statements, table, seed=seed)
    if output is not None:
        write_output(output, _content(statements, entries, output.suffix))
    show_ledger(statements, entries, as_json=as_json)


def read_claims(path: Path) -> Claims:
    """Read a document of claims.

    Raises:
        InvalidInput: the file cannot be read, or is not a document of claims.
    """
    from valerie.analysis.claims.claims import parse_claims
    from valerie.loading import load_document

    return parse_claims(load_document(read_spec(path)))


def show_ledger(statements: Claims, entries: Sequence[LedgerEntry], *, as_json: bool = False) -> None:
    """Print claims with their answers."""
    if as_json:
        print_json(list(map(asdict, entries)))
        return
    from rich.padding import Padding
    from rich.text import Text

    from valerie.analysis.claims.ledger import ClaimOutcome
    from valerie.analysis.claims.text import ledger_notes

    styles = {
        ClaimOutcome.REPRODUCED: "bold green",
        ClaimOutcome.NOT_REPRODUCED: "bold red",
        ClaimOutcome.UNDECIDED: "bold yellow",
    }
    console().print(Text(statements.title, style="bold"))
    for entry in entries:
        head = Text.assemble(
            (entry.outcome.upper(), styles.get(entry.outcome, "bold dim")),
            f"  {entry.id}" + (f" · {entry.function}" if entry.function else ""),
            (f"  {entry.source}", "dim"),
        )
        console().print(head)
        console().print(Padding(Text(f"“{entry.says}”", style="italic"), (0, 0, 0, 2)))
        console().print(Padding(Text(entry.finding), (0, 0, 0, 2)))
    for note in ledger_notes(entries):
        console().print(Text(note, style="dim"))


def _content(statements: Claims, entries: Sequence[LedgerEntry], suffix: str) -> bytes:
    from valerie.analysis.claims.ledger import ledger_table
    from valerie.analysis.claims.text import ledger_text
    from valerie.analysis.rows.table import encoded

    if suffix == ".json":
        return json.dumps(list(map(asdict, entries)), ensure_ascii=False, indent=1).encode()
    if suffix == ".md":
        return ledger_text(statements, entries).encode()
    return encoded(ledger_table(entries), suffix[1:])
