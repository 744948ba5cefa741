"""The evaluation worker: counts predictions against ground truth and finishes runs; the same on every machine."""

from __future__ import annotations

from celery.signals import worker_process_init

from services.eval_worker.tasks import register
from valerie.broker import EVAL_QUEUE, create_app
from valerie.logs import configure_logging
from valerie.pipeline.context import open_context
from valerie.pipeline.makers.evaluation import EvaluateMaker
from valerie.pipeline.workers import Presence, consume
from valerie.settings import load_settings


def main() -> None:
    """Run until told to stop."""
    settings = load_settings()
    configure_logging(settings)
    app = create_app(settings)
    child = register(app)

    @worker_process_init.connect(weak=False)
    def open_child(**_: object) -> None:
        context = open_context(settings)
        child.open(context, EvaluateMaker(context))

    presence = Presence(settings, "eval", [])
    presence.join()
    try:
        consume(app, "eval", [EVAL_QUEUE])
    finally:
        presence.leave()
