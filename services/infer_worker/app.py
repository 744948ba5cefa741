"""The inference worker: offers the functions under test that run on this machine and makes predictions."""

from __future__ import annotations

from celery.signals import worker_process_init

from services.infer_worker.tasks import register
from valerie import plugins
from valerie.broker import create_app
from valerie.logs import configure_logging
from valerie.pipeline.context import open_context
from valerie.pipeline.makers.inference import InferMaker
from valerie.pipeline.workers import Presence, consume, infer_offers, queues_of
from valerie.settings import load_settings


def main() -> None:
    """Run until told to stop."""
    settings = load_settings()
    configure_logging(settings)
    offers = infer_offers(settings.infer_functions.split(",") if settings.infer_functions else plugins.function_names())
    app = create_app(settings)
    child = register(app)

    @worker_process_init.connect(weak=False)
    def open_child(**_: object) -> None:
        context = open_context(settings)
        child.open(context, InferMaker(context))

    presence = Presence(settings, "infer", offers)
    presence.join()
    try:
        consume(app, "infer", queues_of(offers))
    finally:
        presence.leave()
