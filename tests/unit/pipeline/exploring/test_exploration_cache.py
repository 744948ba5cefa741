"""Rows of several runs together."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from tests.world.blank import SMALL, Pipeline
from valerie.pipeline.base.resolved_runs import read_run
from valerie.pipeline.exploring.exploration_cache import Explorations
from valerie.pipeline.exploring.pairs import PairOutcome, Side, compare_sides

SUN = "scene.sun-1.azimuth"
COAT = "scene.person-1.character"


def test_what_a_run_does_not_vary_has_its_constant_or_default(pipelines: Callable[..., Pipeline]) -> None:
    pipeline = pipelines()

    of_all = {name: value for name, value in SMALL.items() if name != "vary"}

    def run(**more: Any) -> str:
        run_id = pipeline.submit({**of_all, "cameras": ["camera-1"], **more})
        assert pipeline.run(run_id) == "completed"
        return run_id

    sun, coat = ["sun-1.azimuth", "CHOICE", 100, 200], ["person-1.character", "CHOICE", "blue-coat", "red-coat"]
    parent = run(vary=[sun, coat])
    child = run(vary=[["person-1.pos.y", "HOMOGENEOUS", 8, 10, 2]], constants={"sun-1.azimuth": 200})
    blocks = run(blocks=[{"vary": [sun]}, {"vary": [coat]}])
    explored = Explorations(pipeline.context).open([parent, child, blocks])
    table = explored.table
    assert {table.arrow[path].null_count for path in table.parameters} == {0}
    defaults = {d.path: d.default for d in read_run(pipeline.context, parent).resolved.definitions}

    def values(run_id: str, path: str) -> set[object]:
        return {row[path] for row in table.arrow.to_pylist() if row["run_id"] == run_id}

    assert (values(child, SUN), values(child, COAT)) == ({200}, {defaults[COAT]})
    assert values(parent, "scene.person-1.pos.y") == {defaults["scene.person-1.pos.y"]}
    assert values(blocks, SUN) == {100, 200, defaults[SUN]}
    of_child = run(constants={"sun-1.azimuth": 200})
    explored = Explorations(pipeline.context).open([parent, of_child])
    compared = compare_sides(
        explored, explored.select(), Side(parent, "blank"), Side(of_child, "blank"),
        threshold=0.5, outcome=PairOutcome.BOTH_MISSED, limit=5,
    )  # fmt: skip
    assert (compared.rows, compared.matched, compared.held) == ((4, 1), 1, [])
