"""Rows, documents and messages of release 0.1.0, read with today's code; `tests.fixtures.write_release` wrote it."""

from __future__ import annotations

import base64
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from celery import Celery
from kombu import Connection as BrokerConnection
from pydantic import TypeAdapter
from sqlalchemy import Engine, insert, select, text
from sqlalchemy.orm import Session

from services.eval_worker.tasks import register
from valerie.analysis.findings.findings import Findings
from valerie.analysis.summary.summary import Summary
from valerie.broker import INFER, RENDER, create_celery
from valerie.db import fed_blocks, frames, functions, processes, results, runs
from valerie.db.engine import open_database, reading, writing
from valerie.db.migrate import migrate
from valerie.db.models import Base, Product, Worker
from valerie.perception.documents.function import FunctionDocument
from valerie.pipeline.work import finish
from valerie.pipeline.work.child import Child, declare_task
from valerie.plain import typed
from valerie.runs.products.frame_keys import FrameKey
from valerie.runs.products.pins import AnyOffer, Pins
from valerie.runs.products.progress import BlockCounts, Progress
from valerie.runs.products.ready import FailedInput, Fault
from valerie.runs.products.states import ProductKind, ProductState, RunState
from valerie.runs.resolving.spec import RunSpec
from valerie.settings import load_settings

RELEASE = Path(__file__).parents[1] / "fixtures" / "release-0.1.0"
FORMS = {
    "spec": RunSpec,
    "pins": Pins,
    "progress": Progress,
    "counts": BlockCounts,
    "assignment": dict[str, float | int | bool | str],
    "function": FunctionDocument,
    "fault": Fault,
    "failed_input": FailedInput,
}


def read(name: str) -> Any:
    return json.loads((RELEASE / f"{name}.json").read_text())


@pytest.fixture
def engine(tmp_path: Path) -> Iterator[Engine]:
    """A database with the release's rows, written as they lay in SQLite."""
    engine = open_database(f"sqlite:///{tmp_path / 'valerie.sqlite3'}")
    migrate(engine)
    rows = read("rows")
    with writing(engine) as connection:
        for table in Base.metadata.sorted_tables:
            for row in rows.get(table.name, ()):  # a later release has further tables
                names = ", ".join(f'"{name}"' for name in row)
                marks = ", ".join("?" for _ in row)
                values = [
                    base64.b64decode(value["base64"]) if isinstance(value, dict) else value for value in row.values()
                ]
                connection.exec_driver_sql(f'INSERT INTO "{table.name}" ({names}) VALUES ({marks})', tuple(values))
    yield engine
    engine.dispose()


@pytest.mark.parametrize("name", FORMS)
def test_a_stored_document_reads_and_loses_nothing(name: str) -> None:
    stored = read("documents")[name]
    form = TypeAdapter(FORMS[name])
    assert json.loads(form.dump_json(form.validate_json(json.dumps(stored)))) == stored


def test_stored_offers_read_and_lose_nothing() -> None:
    stored = read("documents")["offers"]
    offers = TypeAdapter(tuple[AnyOffer, ...])
    assert json.loads(offers.dump_json(offers.validate_json(json.dumps(stored)))) == stored


def test_the_summary_reads() -> None:
    stored = read("documents")["summary"]
    assert typed(Summary, stored["summary"]).rows
    assert typed(Findings, stored["findings"]) is not None


def test_every_row_reads_and_is_written_again_as_it_was(engine: Engine, tmp_path: Path) -> None:
    """Columns and tables of later releases are not compared."""
    copy = open_database(f"sqlite:///{tmp_path / 'copy.sqlite3'}")
    migrate(copy)
    documents = {}
    with reading(engine) as source, writing(copy) as target:
        for table in Base.metadata.sorted_tables:
            if stored := [dict(row) for row in source.execute(select(table)).mappings()]:
                target.execute(insert(table), stored)
            rows = target.execute(text(f'SELECT * FROM "{table.name}"')).mappings()
            documents[table.name] = [readable(dict(row)) for row in rows]
    copy.dispose()
    for name, rows in read("rows").items():
        pairs = list(zip(rows, documents[name], strict=True))
        assert [{column: now[column] for column in then} for then, now in pairs] == [
            readable(then) for then, _ in pairs
        ]


def readable(row: dict[str, Any]) -> dict[str, Any]:
    """A row with its documents as values: their order and spaces may differ."""
    documents: dict[str, Any] = {}
    for name, value in row.items():
        if isinstance(value, bytes):
            documents[name] = {"base64": base64.b64encode(value).decode()}
        elif isinstance(value, str) and value.startswith(("{", "[")):
            documents[name] = json.loads(value)
        else:
            documents[name] = value
    return documents


def test_the_queries_read_the_run_and_what_became_of_it(engine: Engine) -> None:
    with reading(engine) as connection:
        (run,) = runs.page(connection, limit=10)
        assert run.state is RunState.COMPLETED_WITH_FAILURES
        assert run.pins is not None
        assert [pin.kind for pin in run.pins.functions.values()] == ["predictions", None]
        assert fed_blocks.closed_counts(connection, run.id)[0].frames == 4
        frame = frames.get(connection, FrameKey(run.id, 0, 0))
        assert len(results.frame_evaluations(connection, frame.key)) == 2
        assert set(frames.annotation_links(connection, frame.key)) == {"light"}
        assert {link.kind for link in results.failures(connection, run.id)} == {
            ProductKind.PREDICTION,
            ProductKind.EVALUATION,
        }
        seen_at = connection.scalar(select(Worker.seen_at))
        assert seen_at is not None
        (worker,) = processes.workers(connection, now=seen_at)
        assert {offer.name for offer in worker.offers} == {"blank", "truth"}
        assert [row.name for row in functions.every(connection)] == ["mine"]
    with Session(engine) as session:
        states = set(session.scalars(select(Product.state)))
    assert states == {ProductState.DONE, ProductState.FAILED}


@pytest.fixture(scope="module")
def app() -> Celery:
    app = create_celery(load_settings({}, broker_url="memory://"))
    for name in (RENDER, INFER):
        declare_task(name, app)
    register(app)
    return app


@pytest.mark.parametrize(
    ("task", "asked"),
    [
        ("valerie.render", "render.blank.blank"),
        ("valerie.infer", "infer.blank"),
        ("valerie.evaluate", "eval"),
        ("valerie.finish", "r1ng219w3v1ks"),
    ],
)
def test_a_worker_does_what_a_message_asks(app: Celery, monkeypatch: pytest.MonkeyPatch, task: str, asked: str) -> None:
    done: list[str] = []
    monkeypatch.setattr(Child, "serve", lambda _, route: done.append(route))
    monkeypatch.setattr(Child, "context", None)
    monkeypatch.setattr(finish, "finish_run", lambda _, run_id: done.append(run_id))
    with BrokerConnection("memory://") as connection:
        message = connection.default_channel.message_to_python(read("messages")[task])
    arguments, keywords, _ = message.decode()
    app.tasks[message.headers["task"]](*arguments, **keywords)
    assert done == [asked]
