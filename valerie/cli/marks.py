"""The command that marks runs, frames and findings."""

from __future__ import annotations

from typing import Annotated

import typer

from valerie.cli.shell import AsJson, DataDir, Url


def mark(
    target: Annotated[str, typer.Argument(metavar="RUN|FRAME", help="Id of a run or of a frame.")],
    finding: Annotated[
        int | None, typer.Option("--finding", metavar="N", help="A finding or candidate, by its number in the report.")
    ] = None,
    tags: Annotated[list[str] | None, typer.Option("--tag", help="Add a tag; may be repeated.")] = None,
    untag: Annotated[list[str] | None, typer.Option("--untag", help="Remove a tag; may be repeated.")] = None,
    note: Annotated[str | None, typer.Option("--note", help="Replace the note; an empty text removes it.")] = None,
    as_json: AsJson = False,
    url: Url = None,
    data_dir: DataDir = None,
) -> None:
    """Put tags and a note on a run, a frame or a finding; without options, show those of the run.

    They are for people: no spec, digest or result contains them. They are deleted with the run.
    """
    from valerie.analysis.findings.findings import Findings
    from valerie.answers import Mark
    from valerie.cli.connecting import client_at
    from valerie.plain import typed

    run_id, _, name = target.partition(".")
    with client_at(url, data_dir) as client:
        marks = client.marks(run_id)
        kind = "frame" if name else "run"
        if finding is not None:
            findings = typed(Findings, client.summary(run_id).findings)
            kind, name = "finding", findings.numbered(finding).sentence
        if tags or untag or note is not None:
            present = next((mark for mark in marks if (mark.kind, mark.name) == (kind, name)), None)
            kept = set(present.tags if present else ()) - set(untag or ()) | set(tags or ())
            text = note if note is not None else present.note if present else ""
            marks = client.put_mark(run_id, Mark(kind=kind, name=name, tags=tuple(sorted(kept)), note=text))
    for mark in marks:
        if as_json:
            typer.echo(mark.model_dump_json())
        else:
            subject = run_id if mark.kind == "run" else f"{run_id}.{mark.name}" if mark.kind == "frame" else mark.name
            typer.echo(": ".join(part for part in (subject, ", ".join(mark.tags), mark.note) if part))
