"""The evaluation worker: counts predictions against ground truth and finishes runs; the same on every machine."""

from __future__ import annotations

from services.eval_worker.tasks import register
from valerie.logs import configure_logging
from valerie.pipeline.work.makers.evaluation import EvaluateMaker
from valerie.pipeline.work.workers import serve
from valerie.runs.products.pins import Probed
from valerie.runs.products.states import Stage
from valerie.settings import load_settings


def main() -> None:
    """Run until a signal ends the process."""
    settings = load_settings()
    configure_logging(settings)
    serve(settings, Stage.EVAL, probe=lambda _: Probed(offers=()), register=register, open_maker=EvaluateMaker)
