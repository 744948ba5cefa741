"""The registry on Postgres: the same versions, also when several register at the same time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from valerie.db import functions
from valerie.db.engine import reading
from valerie.db.migrate import migrate
from valerie.errors import NotFound, UnknownName
from valerie.perception.documents.function import FunctionDocument
from valerie.perception.running.small_network import small_onnx
from valerie.pipeline.base.context import Context, open_context
from valerie.pipeline.functions import registry
from valerie.settings import load_settings

pytestmark = [pytest.mark.processes, pytest.mark.timeout(300)]


@pytest.fixture
def context(new_database: Callable[[], str], tmp_path: Path) -> Iterator[Context]:
    settings = load_settings({}, data_dir=tmp_path, database_url=new_database(), broker_url="memory://")
    context = open_context(settings)
    migrate(context.engine)
    yield context
    context.engine.dispose()


def test_versions_are_numbered_once_each_when_several_register_at_the_same_time(
    context: Context, tmp_path: Path
) -> None:
    base, payload = small_onnx(tmp_path)
    documents = [base.model_copy(update={"provenance": {"seed": str(seed % 4)}}) for seed in range(8)]

    def register(document: FunctionDocument) -> bool:
        return registry.register(context, document, payload)[1]

    with ThreadPoolExecutor(4) as pool:
        new = list(pool.map(register, documents))
    with reading(context.engine) as connection:
        versions = functions.every(connection)
    assert [version.version for version in versions] == [4, 3, 2, 1]
    assert sum(new) == 4
    assert {version.digest for version in versions} == {one.digest for one in documents}


def test_what_is_removed_is_gone(context: Context, tmp_path: Path) -> None:
    version, _ = registry.register(context, *small_onnx(tmp_path))
    registry.remove(context, version.reference)
    with reading(context.engine) as connection, pytest.raises(UnknownName, match="unknown registered function"):
        registry.find(connection, "small")
    with pytest.raises(NotFound):
        registry.read_payload(context, version.document)
