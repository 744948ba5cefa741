"""A run whose engine computes in a process of its own: what becomes of crashes, hangs and settings."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import select

from tests.world.blank import Pipeline
from tests.world.boxes import spec
from valerie.db.engine import reading
from valerie.db.models import Product
from valerie.pipeline.functions.probe import probe_engine, probe_function
from valerie.rendering.cycles.blender import BlenderHolder
from valerie.rendering.cycles.renderer import numeric_class
from valerie.runs.products.pins import Offer
from valerie.runs.products.states import Stage, route_of
from valerie.settings import load_settings

FAKE = Path(__file__).parents[1] / "rendering" / "cycles" / "fake_blender.py"
SMALL = {**spec(xs=2, ys=1), "renderer": {"name": "cycles", "samples": 2}, "resolution": {"width": 24, "height": 16}}


@pytest.fixture
def with_blender(
    pipelines: Callable[..., Pipeline], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Callable[[str], Pipeline]]:
    """Makes a pipeline whose worker offers Cycles with a fake Blender."""

    holders: list[BlenderHolder] = []

    def make(behaviour: str) -> Pipeline:
        python = tmp_path / "python"
        python.write_text(f'#!/bin/sh\nexec {sys.executable} {FAKE} "{behaviour}" "$@"\n')
        python.chmod(0o755)
        monkeypatch.setenv("TMPDIR", str(tmp_path))
        holders.append(BlenderHolder(load_settings({}, cycles_python=python, cycles_silence_seconds=0.6)))
        monkeypatch.setattr("valerie.rendering.cycles.renderer.process_blender", lambda _: holders[-1])
        pipeline = pipelines(workers=False)
        known_as = numeric_class("9.9.9 LTS", "CPU", "")  # as the fake introduces itself
        route = route_of(Stage.RENDER, "cycles", known_as)
        cycles = Offer(stage=Stage.RENDER, name="cycles", numeric_class=known_as, revision=1, route=route)
        truth = (offer for offer in probe_engine("blank") if offer.name == "truth")
        pipeline.offer("w", cycles, *truth, *probe_function("blank"))
        return pipeline

    yield make
    for holder in holders:
        holder.close()


def products(pipeline: Pipeline, kind: str) -> list[Any]:
    with reading(pipeline.context.engine) as connection:
        return list(connection.execute(select(Product).where(Product.kind == kind)))


def test_a_run_completes_and_blenders_cpu_seconds_count(with_blender: Callable[[str], Pipeline]) -> None:
    pipeline = with_blender("works")
    assert pipeline.run(pipeline.submit(SMALL)) == "completed"
    assert min(row.cpu_seconds for row in products(pipeline, "layer")) > 0.25


@pytest.mark.parametrize(("behaviour", "message"), [("crashes", "Segmentation fault"), ("hangs", "no sign of life")])
def test_an_engine_that_never_answers_is_tried_again_and_then_a_recorded_failure(
    with_blender: Callable[[str], Pipeline], behaviour: str, message: str
) -> None:
    pipeline = with_blender(behaviour)
    assert pipeline.run(pipeline.submit(SMALL)) == "completed-with-failures"
    for row in products(pipeline, "background"):
        assert row.error.type == "TransientError"
        assert message in row.error.message
        assert row.attempts == row.error.attempts == 2


def test_one_crash_costs_nothing_but_time(with_blender: Callable[[str], Pipeline]) -> None:
    pipeline = with_blender("crashes once")
    assert pipeline.run(pipeline.submit(SMALL)) == "completed"
    assert max(row.attempts for row in products(pipeline, "background")) == 2


def test_other_settings_are_other_pictures_and_the_same_truth(with_blender: Callable[[str], Pipeline]) -> None:
    pipeline = with_blender("works")
    pipeline.run(pipeline.submit(SMALL))
    counts = {kind: len(products(pipeline, kind)) for kind in ("background", "layer", "truth")}
    pipeline.run(pipeline.submit({**SMALL, "renderer": {"name": "cycles", "samples": 3}}))
    again = {kind: len(products(pipeline, kind)) for kind in counts}
    assert again == {"background": 2 * counts["background"], "layer": 2 * counts["layer"], "truth": counts["truth"]}


def test_a_run_without_such_a_worker_waits_and_says_how_to_get_one(pipelines: Callable[..., Pipeline]) -> None:
    pipeline = pipelines()
    run = pipeline.submit(SMALL)
    pipeline.step()
    assert pipeline.state(run) == "submitted"
    assert "'cycles' (`make cycles` installs it)" in pipeline.row(run).reason
