"""The order in which workers serve runs that share them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from itertools import cycle

import pytest

from tests.world.blank import Pipeline
from tests.world.boxes import spec
from valerie.broker import TaskMessage, messages_of
from valerie.db import links
from valerie.db.engine import reading
from valerie.pipeline.work.stages import serve_queue
from valerie.runs.products.states import Priority, ProductKind, Stage
from valerie.runs.products.turns import Turns, packet_size

LARGE, SMALL = spec(xs=12, ys=10), spec(xs=2, ys=2, constants={"sun-1.elevation": 12})
PACKET = packet_size(ProductKind.LAYER)


class Workers:
    """One worker per stage; they answer messages in turn, in the order of arrival."""

    def __init__(self, pipeline: Pipeline) -> None:
        self._pipeline = pipeline
        self._messages: list[TaskMessage] = []
        self._stages = cycle(Stage)

    def answer(self) -> bool:
        """Answer the next message; return False where there is none."""
        self._messages += messages_of(self._pipeline.broker.ready)
        self._pipeline.broker.ready.clear()
        for stage in (next(self._stages) for _ in Stage):
            for message in self._messages:
                if message.queue.startswith(stage):
                    self._messages.remove(message)
                    serve_queue(self._pipeline.context, self._pipeline.makers[stage], message.argument)
                    return True
        return False


def products_of(pipeline: Pipeline, run_id: str) -> dict[str, str]:
    """Return the states of a run's products."""
    with reading(pipeline.context.engine) as connection:
        states = {row.digest: row.state for row in pipeline.products()}
        everything = connection.scalars(links.links_of(run_id).select())
        return {digest: states[digest] for digest in everything if digest is not None}


def made_meanwhile(pipeline: Pipeline, *, large: Priority, small: Priority) -> tuple[int, int]:
    """Start a small run in the middle of a large one.

    Returns:
        The products of the small run, and those of the large run that were made while the small one was in work.
    """
    workers = Workers(pipeline)
    first = pipeline.submit(LARGE, priority=large)
    pipeline.loop.tick(everything=True)
    for _ in range(12):
        assert workers.answer()
    second = pipeline.submit(SMALL, priority=small)
    pipeline.loop.tick(everything=True)
    done = Counter(products_of(pipeline, first).values())["done"]
    while set(products_of(pipeline, second).values()) != {"done"}:
        assert workers.answer()
    return len(products_of(pipeline, second)), Counter(products_of(pipeline, first).values())["done"] - done


@pytest.mark.parametrize(
    ("large", "small"),
    [(Priority.NORMAL, Priority.NORMAL), (Priority.NORMAL, Priority.HIGH), (Priority.LOW, Priority.NORMAL)],
)
def test_a_small_run_ends_beside_a_large_one_as_if_it_had_its_share_of_the_workers(
    large: Priority, small: Priority, pipeline: Pipeline
) -> None:
    own, others = made_meanwhile(pipeline, large=large, small=small)
    # The other run's share, and in each queue a packet before the first of the small run and one in the middle of it.
    assert others <= own * large.weight / small.weight + 2 * PACKET * len(Stage)


def test_without_turns_it_would_wait_for_most_of_the_large_one(
    pipeline: Pipeline, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Turns, "take", lambda self, *_: self._start)
    own, others = made_meanwhile(pipeline, large=Priority.NORMAL, small=Priority.NORMAL)
    assert others > own + 2 * PACKET * len(Stage)


def test_one_message_per_packet_is_enough_for_all_products(pipelines: Callable[..., Pipeline]) -> None:
    pipeline = pipelines(resend_seconds=86_400)  # no sweep sends a message again
    both = [pipeline.submit(LARGE), pipeline.submit(SMALL)]
    pipeline.loop.tick(everything=True)
    workers = Workers(pipeline)
    while workers.answer():
        pass
    assert {state for run_id in both for state in products_of(pipeline, run_id).values()} == {"done"}


def test_a_product_of_two_runs_is_made_at_the_earlier_turn(pipeline: Pipeline) -> None:
    urgent = LARGE | {"name": "urgent"}  # the same products
    turns = []
    for document, priority in ((LARGE, Priority.NORMAL), (urgent, Priority.HIGH), (LARGE, Priority.LOW)):
        pipeline.submit(document, priority=priority)
        pipeline.loop.tick(everything=True)
        turns.append({row.digest: row.turn for row in pipeline.products()})
    normal, high, low = turns
    assert high == low
    for digest, turn in normal.items():
        assert high[digest] == turn * Priority.NORMAL.weight / Priority.HIGH.weight
    assert any(normal.values())
