"""Metrics of costs and of failures."""

from __future__ import annotations

from sqlalchemy import select, update

from tests.world.blank import SMALL, Pipeline
from valerie.db.engine import writing
from valerie.db.models import Product
from valerie.pipeline.control.monitoring import metrics
from valerie.runs.products.ready import Fault
from valerie.runs.products.states import ProductKind, ProductState


def values(text: str, name: str) -> dict[str, float]:
    """Value by labels of the samples with a name."""
    samples = (line.rpartition(" ") for line in text.splitlines() if line.startswith(f"{name}{{"))
    return {labels.removeprefix(name): float(value) for labels, _, value in samples}


def test_costs_are_counted_by_kind_up_to_each_bound(pipeline: Pipeline) -> None:
    pipeline.run(pipeline.submit(SMALL))
    with writing(pipeline.context.engine) as connection:
        layers = connection.scalars(select(Product.digest).where(Product.kind == ProductKind.LAYER)).all()
        assert len(layers) >= 3
        for digest, seconds in zip(layers, [0.1, 0.2, 2000.0, *[50.0] * len(layers)], strict=False):
            connection.execute(update(Product).where(Product.digest == digest).values(cpu_seconds=seconds))
    text = metrics(pipeline.context)
    counts = values(text, "valerie_product_cpu_seconds_bucket")
    others = len(layers) - 3
    expected = {"0.03": 0, "0.1": 1, "0.3": 2, "30.0": 2, "100.0": 2 + others, "1000.0": 2 + others, "+Inf": 3 + others}
    assert {bound: counts[f'{{kind="layer",le="{bound}"}}'] for bound in expected} == expected
    sums = values(text, "valerie_product_cpu_seconds_gsum")
    assert abs(sums['{kind="layer"}'] - (2000.3 + 50 * others)) < 1e-6
    assert not any('kind="flow"' in labels for labels in counts)


def test_failures_are_counted_by_reason(pipeline: Pipeline) -> None:
    pipeline.run(pipeline.submit(SMALL))
    assert values(metrics(pipeline.context), "valerie_failure_reasons") == {}
    with writing(pipeline.context.engine) as connection:
        layers = connection.scalars(select(Product.digest).where(Product.kind == ProductKind.LAYER)).all()
        for number, digest in enumerate(layers):
            fault = Fault(stage="layer", type="RenderingError" if number else "WorkerLost", message="no", attempts=2)
            failed = update(Product).where(Product.digest == digest)
            connection.execute(failed.values(state=ProductState.FAILED, error=fault))
    assert values(metrics(pipeline.context), "valerie_failure_reasons") == {
        '{error="RenderingError",kind="layer"}': len(layers) - 1,
        '{error="WorkerLost",kind="layer"}': 1,
    }
