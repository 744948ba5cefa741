"""Titles of problem documents: words for people, not names of classes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import httpx
import pytest
from fastapi import FastAPI

from services.api import problems
from tests.world.serving import served
from valerie.errors import (
    Conflict,
    CorruptArtifact,
    InferenceError,
    InvalidInput,
    InvalidInputs,
    MissingDependency,
    NotFound,
    RenderingError,
    StorageFull,
    StorageUnavailable,
    TransientError,
    UnknownName,
    ValerieError,
)

UNKNOWN: Final = UnknownName("engine", "rastr", ["raster"], field="renderer")
WRONG: Final = InvalidInput("must be above 0", field="step", value=0)

ERRORS: Final[list[tuple[Exception, int, str]]] = [
    (WRONG, 422, "Invalid input"),
    (UNKNOWN, 422, "Unknown name"),
    (InvalidInputs([UNKNOWN]), 422, "Unknown name"),
    (InvalidInputs([WRONG]), 422, "Invalid input"),
    (InvalidInputs([UNKNOWN, WRONG]), 422, "Invalid input"),
    (NotFound("run", "r1"), 404, "Not found"),
    (Conflict("it is completed"), 409, "Conflict"),
    (MissingDependency("torch is not installed"), 501, "Missing library"),
    (StorageFull("no space left"), 507, "No space left"),
    (StorageUnavailable("no bucket"), 503, "Temporarily unavailable"),
    (TransientError("the broker does not answer"), 503, "Temporarily unavailable"),
    (CorruptArtifact("a digest differs"), 500, "Broken artifact"),
    (RenderingError("a black image"), 500, "Rendering failed"),
    (InferenceError("no class map"), 500, "Inference failed"),
    (ValerieError("something else"), 500, "Failed"),
]


@pytest.fixture(scope="module")
def failing() -> Iterator[httpx.Client]:
    app = FastAPI()
    problems.install(app)

    @app.get("/{number}")
    def fail(number: int) -> None:
        raise ERRORS[number][0]

    with served(app) as client:
        yield client


@pytest.mark.parametrize("number", range(len(ERRORS)))
def test_an_error_of_valerie_has_a_title_in_words_and_the_stable_type(failing: httpx.Client, number: int) -> None:
    error, status, title = ERRORS[number]
    answer = failing.get(f"/{number}")
    document = answer.json()
    assert (document["type"], document["title"], document["status"]) == ("about:blank", title, status)
    assert document["detail"] == str(error)
    assert answer.headers.get("Retry-After") == ("5" if status == 503 else None)


def test_malformed_input_has_the_title_of_other_invalid_input(failing: httpx.Client) -> None:
    assert failing.get("/x").json()["title"] == "Invalid input"


def test_an_unknown_address_has_the_title_of_missing_things(failing: httpx.Client) -> None:
    assert failing.get("/a/b").json()["title"] == "Not found"


def test_an_unknown_name_is_shown_with_the_known_ones(failing: httpx.Client) -> None:
    (problem,) = failing.get("/1").json()["errors"]
    assert (problem["field"], problem["value"], problem["limit"]) == ("renderer", "rastr", "raster")
