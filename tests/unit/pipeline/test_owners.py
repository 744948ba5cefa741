"""Owners share the workers equally, and the runs of an owner by priority; counted in claims of one queue."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from itertools import accumulate, pairwise
from typing import Any

import pytest
from sqlalchemy import update

from tests.world.blank import Pipeline
from tests.world.boxes import spec
from valerie.db import claiming
from valerie.db.claiming import Job
from valerie.db.engine import database_time, writing
from valerie.db.models import Product
from valerie.pipeline.control.sharing import MOST_URGENT, parts_of
from valerie.runs.products.states import Priority, ProductKind, ProductState
from valerie.runs.products.turns import packet_size

PACKET = packet_size(ProductKind.LAYER)


def street(number: int, xs: int = 12, ys: int = 10) -> dict[str, Any]:
    """A run of ``xs`` · ``ys`` places; those of different numbers have no product in common."""
    return spec(xs=xs, ys=ys, constants={"sun-1.elevation": 10 + number})


class Queue:
    """Takes packets of the engine's queue as a worker does: it has made one when it takes the next. Other queues stand still."""

    def __init__(self, pipeline: Pipeline) -> None:
        self._engine = pipeline.context.engine
        self._route = next(row.route for row in pipeline.products() if row.kind is ProductKind.LAYER)

    def take(self) -> list[Job]:
        with writing(self._engine) as connection:
            now = database_time(connection)
            connection.execute(
                update(Product).where(Product.state == ProductState.RUNNING).values(state=ProductState.DONE)
            )
            return claiming.claim_next(connection, self._route, owner="w", now=now, lease_seconds=1e6)

    def takes(self, *runs: Sequence[str], packets: int = 10_000) -> list[int]:
        """Take packets while each group of runs gets one at least every 20 packets; return the group of each product."""
        group = {run: number for number, ids in enumerate(runs) for run in ids}
        taken: list[int] = []
        waits = Counter(dict.fromkeys(range(len(runs)), 0))
        for _ in range(packets):
            jobs = self.take()
            if not jobs:
                break
            numbers = [group[job.frame.key.run_id] for job in jobs]
            taken += numbers
            waits.update(range(len(runs)))
            waits.update({number: -waits[number] for number in numbers})
            if max(waits.values()) > 20:
                break
        ends = [max(place for place, other in enumerate(taken) if other == number) for number in range(len(runs))]
        return taken[: min(ends) + 1]


def largest_lead(taken: Sequence[int], *, weights: tuple[float, float] = (1.0, 1.0)) -> float:
    """Return by how much one of two groups is ahead in the window of takes where that is most, in products of weight 1."""
    steps = [1 / weights[0] if number == 0 else -1 / weights[1] for number in taken]
    sums = list(accumulate(steps, initial=0.0))
    return max(sums) - min(sums)


def test_an_owner_with_ten_runs_gets_no_more_than_one_with_a_single_run(pipeline: Pipeline) -> None:
    many = [pipeline.submit(street(number, ys=2), owner="many") for number in range(10)]
    one = pipeline.submit(street(20), owner="one")
    pipeline.loop.tick(everything=True)
    taken = Queue(pipeline).takes(many, [one])
    assert Counter(taken)[1] > 200
    assert largest_lead(taken) <= 2 * PACKET


def test_without_lines_it_would_get_ten_times_as_much(pipeline: Pipeline) -> None:
    many = [pipeline.submit(street(number, ys=2), owner="same") for number in range(10)]
    one = pipeline.submit(street(20), owner="same")
    pipeline.loop.tick(everything=True)
    counts = Counter(Queue(pipeline).takes(many, [one]))
    assert counts[0] > 3 * counts[1]


def test_what_nobody_owns_is_one_owner_more(pipeline: Pipeline) -> None:
    nobody = [pipeline.submit(street(number, ys=3)) for number in range(4)]
    one = pipeline.submit(street(20), owner="one")
    pipeline.loop.tick(everything=True)
    assert largest_lead(Queue(pipeline).takes(nobody, [one])) <= 2 * PACKET


def test_runs_of_an_owner_share_by_priority_and_take_nothing_from_others(pipeline: Pipeline) -> None:
    high = pipeline.submit(street(0), owner="a", priority=Priority.HIGH)
    normal = pipeline.submit(street(1), owner="a")
    low = pipeline.submit(street(2), owner="b", priority=Priority.LOW)
    pipeline.loop.tick(everything=True)
    taken = Queue(pipeline).takes([high], [normal], [low])
    assert largest_lead([0 if number < 2 else 1 for number in taken]) <= 2 * PACKET
    # In its own count, a packet of the run of weight 4 is a fourth as long; each run may also be at its background.
    own = [number for number in taken if number < 2]
    assert largest_lead(own, weights=(4.0, 1.0)) <= 2 * PACKET + 2
    assert Counter(own)[0] > 150


@pytest.mark.parametrize("owner", ["a", "b"])
def test_a_late_run_gets_its_share_from_its_start_and_nothing_for_the_time_before(
    owner: str, pipeline: Pipeline
) -> None:
    first = pipeline.submit(street(0, ys=20), owner="a")
    pipeline.loop.tick(everything=True)
    queue = Queue(pipeline)
    for _ in range(10):
        assert queue.take()
    second = pipeline.submit(street(1, ys=4), owner=owner)
    pipeline.loop.tick(everything=True)
    taken = queue.takes([first], [second])
    assert len(taken) > 6 * PACKET
    assert largest_lead(taken) <= 2 * PACKET + 2


def test_an_owner_that_had_nothing_for_a_while_does_not_catch_up(pipeline: Pipeline) -> None:
    early = pipeline.submit(street(0, ys=1), owner="b")
    long = pipeline.submit(street(1, ys=20), owner="a")
    pipeline.loop.tick(everything=True)
    queue = Queue(pipeline)
    had = 0
    while had < 2 + 2 * 12:  # a background and the layers of each camera
        had += sum(job.frame.key.run_id == early for job in queue.take())
    for _ in range(10):
        assert {job.frame.key.run_id for job in queue.take()} == {long}
    back = pipeline.submit(street(2, ys=3), owner="b")
    pipeline.loop.tick(everything=True)
    taken = queue.takes([long], [back])
    assert len(taken) > 4 * PACKET
    assert largest_lead(taken) <= 2 * PACKET + 2


def test_a_product_of_two_owners_is_in_the_line_where_it_is_nearer(pipeline: Pipeline) -> None:
    large = street(0)
    pipeline.submit(large, owner="a")
    pipeline.loop.tick(everything=True)
    queue = Queue(pipeline)
    end = large | {"name": "its end", "vary": [["person-1.pos.x", "HOMOGENEOUS", -1.9, -1.9, 0.1], large["vary"][1]]}
    far = max(row.turn for row in pipeline.products())
    pipeline.submit(end, owner="b")
    pipeline.loop.tick(everything=True)
    moved = {row.digest for row in pipeline.products() if row.owner == "b" and row.kind is ProductKind.LAYER}
    assert len(moved) == 20, "no layer of the small run waits in the long line"
    taken: list[str] = []
    while not moved <= set(taken):
        taken += [job.digest for job in queue.take()]
    assert len(taken) < far / 5


def test_lines_do_not_break_up_the_warm_cache(pipelines: Callable[..., Pipeline]) -> None:
    changes = []
    for owners in ("aaaa", "aabb", "abcd"):
        pipeline = pipelines(owners)
        for number, owner in enumerate(owners):
            pipeline.submit(street(number, ys=5), owner=owner)
        pipeline.loop.tick(everything=True)
        queue, taken = Queue(pipeline), list[str]()
        while jobs := queue.take():
            taken += [job.digest for job in jobs]
        group = {row.digest: row.cache_group for row in pipeline.products()}
        changes.append(sum(group[before] != group[after] for before, after in pairwise(taken)))
    one_line, *several = changes
    assert one_line > 10
    assert max(several) <= one_line


def test_the_window_is_divided_as_the_workers_are(pipeline: Pipeline) -> None:
    many = [pipeline.submit(street(number), owner="many") for number in range(8)]
    high = pipeline.submit(street(8), owner="two", priority=Priority.HIGH)
    normal = pipeline.submit(street(9), owner="two")
    rows = [pipeline.row(run_id) for run_id in [*many, high, normal]]
    parts = parts_of(rows, {row.id: row.priority.weight for row in rows})
    assert {parts[run_id] for run_id in many} == {1 / 16}
    assert parts[high] == pytest.approx(0.4)
    assert parts[normal] == pytest.approx(0.1)


def test_a_deadline_takes_from_the_other_runs_of_its_owner_only(pipeline: Pipeline) -> None:
    late = pipeline.submit(street(0, ys=16), owner="a", deadline=datetime(2020, 1, 1, tzinfo=UTC))
    calm = pipeline.submit(street(1, ys=16), owner="a")
    other = pipeline.submit(street(2), owner="b")
    pipeline.loop.tick(everything=True)
    taken = Queue(pipeline).takes([late], [calm], [other])
    assert largest_lead([0 if number < 2 else 1 for number in taken]) <= 2 * PACKET
    own = [number for number in taken if number < 2]
    assert largest_lead(own, weights=(MOST_URGENT, 1.0)) <= 2 * PACKET + 2
    assert len(own) > 150
