"""Truths measured alone, beside the rows of a run of the same spec."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.world.blank import SMALL, Pipeline
from valerie import plugins
from valerie.pipeline.base.resolved_runs import read_run, resolve_new
from valerie.pipeline.reading.tables import read_table
from valerie.pipeline.work.truth_only import MeasuredVariant, chosen_spec, measure_truths, price_of_layers
from valerie.runs.resolving.spec import ResolvedRun, parse
from valerie.runs.resolving.where import compile_where
from valerie.scene.assets.asset import load_asset


@pytest.fixture(scope="module")
def pipeline(tmp_path_factory: pytest.TempPathFactory, assets: Path) -> Pipeline:
    return Pipeline(tmp_path_factory.mktemp("truths"), assets)


@pytest.fixture(scope="module")
def measured(pipeline: Pipeline) -> tuple[ResolvedRun, list[MeasuredVariant]]:
    resolved = resolve_new(parse(SMALL), pipeline.settings)
    asset = load_asset(resolved.spec.asset, asset_dir=pipeline.settings.asset_dir)
    truth_pass = plugins.create_truth_pass("blank")
    try:
        variants = list(measure_truths(resolved, asset, truth_pass))
    finally:
        truth_pass.close()
    assert price_of_layers(resolved, asset, variants[:2]) > 0
    return resolved, variants


def test_measures_are_those_of_a_run(pipeline: Pipeline, measured: tuple[ResolvedRun, list[MeasuredVariant]]) -> None:
    run = pipeline.submit()
    assert pipeline.run(run) == "completed"
    theirs = read_table(pipeline.context.engine, read_run(pipeline.context, run)).arrow.to_pylist()
    names = (
        "variant_index",
        "camera",
        "instance_id",
        "distance_m",
        "pixel_area",
        "occlusion_rate",
        "sun_elevation_deg",
    )
    ours = [row for variant in measured[1] for row in variant.rows]
    assert [tuple(row[name] for name in names) for row in ours] == [
        tuple(row[name] for name in names) for row in theirs
    ]
    assert any(row["distance_m"] is not None for row in ours)
    assert all(row["pacc"] is None for row in ours)


def test_the_chosen_variants_are_a_spec_of_their_own(
    pipeline: Pipeline, measured: tuple[ResolvedRun, list[MeasuredVariant]]
) -> None:
    resolved, variants = measured
    distances = sorted(
        row["distance_m"] for variant in variants for row in variant.rows if row["distance_m"] is not None
    )
    near = compile_where(f"distance_m < {distances[2]}", resolved.definitions)
    chosen = [variant for variant in variants if any(map(near.holds, variant.rows))]
    assert 0 < len(chosen) < len(variants)
    text = chosen_spec(resolved, chosen).to_yaml()
    again = resolve_new(parse(text), pipeline.settings)
    assert [dict(assignment.values) for assignment in again.space] == [dict(v.assignment.values) for v in chosen]
