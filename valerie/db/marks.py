"""Queries about marks: the tags and notes that people put on runs, frames and findings."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection
from dataclasses import dataclass
from datetime import datetime

from sqlalchemy import ColumnElement, Connection, delete, exists, func, insert, select

from valerie.db.models import MarkTag, Note, Run
from valerie.db.statements import within
from valerie.runs.marks import Mark, MarkKind, Subject


@dataclass(frozen=True, slots=True)
class MarkRow:
    """A mark of a run.

    Attributes:
        subject: what is marked.
        mark: tags and note.
        changed_at: when somebody last changed it.
    """

    subject: Subject
    mark: Mark
    changed_at: datetime


def put(connection: Connection, run_id: str, subject: Subject, mark: Mark, changed_at: datetime) -> None:
    """Replace the mark of a subject; an empty one removes it."""
    where = {"run_id": run_id, "kind": subject.kind, "name": subject.name}
    for table in (MarkTag, Note):
        connection.execute(delete(table).filter_by(**where))
    if mark:
        connection.execute(insert(Note).values(**where, text=mark.note, changed_at=changed_at))
        for tag in mark.tags:
            connection.execute(insert(MarkTag).values(**where, tag=tag))


def listed(connection: Connection, run_id: str) -> list[MarkRow]:
    """Return the marks of a run and its parts."""
    tags: defaultdict[tuple[MarkKind, str], list[str]] = defaultdict(list)
    for kind, name, tag in connection.execute(
        select(MarkTag.kind, MarkTag.name, MarkTag.tag).where(MarkTag.run_id == run_id).order_by(MarkTag.tag)
    ):
        tags[kind, name].append(tag)
    query = (
        select(Note.kind, Note.name, Note.text, Note.changed_at)
        .where(Note.run_id == run_id)
        .order_by(Note.kind, Note.name)
    )
    return [
        MarkRow(Subject(kind=kind, name=name), Mark(tags=tuple(tags[kind, name]), note=text), changed_at)
        for kind, name, text, changed_at in connection.execute(query)
    ]


def tags_of_runs(connection: Connection, run_ids: Collection[str]) -> dict[str, list[str]]:
    """Return the tags of those runs that have any, by run id."""
    tags: defaultdict[str, list[str]] = defaultdict(list)
    query = select(MarkTag.run_id, MarkTag.tag).where(MarkTag.kind == MarkKind.RUN, MarkTag.run_id.in_(run_ids))
    for run_id, tag in connection.execute(query.order_by(MarkTag.tag)):
        tags[run_id].append(tag)
    return dict(tags)


def known_tags(connection: Connection, *, project: str = "") -> dict[str, int]:
    """Return the number of runs that carry each tag; of a project, if it is not empty."""
    query = select(MarkTag.tag, func.count()).join(Run, Run.id == MarkTag.run_id).where(within(Run, project))
    query = query.where(MarkTag.kind == MarkKind.RUN).group_by(MarkTag.tag)
    return {tag: int(count) for tag, count in connection.execute(query.order_by(MarkTag.tag))}


def tagged(tag: str) -> ColumnElement[bool]:
    """Return the condition that a run carries a tag."""
    return exists().where(MarkTag.run_id == Run.id, MarkTag.kind == MarkKind.RUN, MarkTag.tag == tag)


def remove_all(connection: Connection, run_id: str) -> None:
    """Remove all marks of a run and its parts."""
    for table in (MarkTag, Note):
        connection.execute(delete(table).where(table.run_id == run_id))
