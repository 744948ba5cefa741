"""The product's own makers with the blank engine and function."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tests.world.boxes import spec, write_box_street
from tests.world.world import World, settings_of
from valerie.pipeline.functions.probe import probe_engine, probe_function
from valerie.pipeline.work.makers.inference import InferMaker
from valerie.pipeline.work.makers.rendering import RenderMaker
from valerie.runs.products.states import Stage

#: 12 places, two cameras: 24 frames.
SMALL = spec(xs=4, ys=3)


class Pipeline(World):
    """A deployment whose products come from the blank engine; it is quick to send again, to sweep and to give up."""

    def __init__(self, folder: Path, assets: Path, *, workers: bool = True, **settings: Any) -> None:
        values = {"resend_seconds": 0.1, "sweep_seconds": 0.01, "max_attempts": 2}
        values |= {"broker_url": "memory://"}
        values |= {"infer_memory_mb": 0, **settings}  # by default no limit on the process that runs the tests
        super().__init__(
            settings_of(folder, asset_dir=assets, testing_engines=True, **values),
            lambda context: {Stage.RENDER: RenderMaker(context), Stage.INFER: InferMaker(context)},
        )
        if workers:
            self.add_worker()

    def add_worker(self) -> None:
        self.offer("w", *probe_engine("blank"), *probe_function("blank"))

    def submit(self, document: dict[str, Any] = SMALL, **keywords: Any) -> str:
        return super().submit(document, **keywords)


def street_pipeline(folder: Path, **settings: Any) -> Pipeline:
    """Return a pipeline with ``data`` and ``assets``, the street of boxes, below ``folder``."""
    write_box_street(folder / "assets" / "box-street")
    return Pipeline(folder / "data", folder / "assets", **settings)


def completed_run(folder: Path, **more: Any) -> tuple[Pipeline, str]:
    """Return a completed run of `SMALL` with ``more`` below ``folder``, and its id."""
    pipeline = street_pipeline(folder)
    run_id = pipeline.submit(SMALL | more)
    assert pipeline.run(run_id) == "completed"
    return pipeline, run_id
