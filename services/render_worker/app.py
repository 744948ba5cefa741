"""The render worker: offers the engines that work on this machine and makes backgrounds, layers and ground truth."""

from __future__ import annotations

from celery.signals import worker_process_init

from services.render_worker.tasks import register
from valerie.broker import create_app
from valerie.logs import configure_logging
from valerie.pipeline.context import open_context
from valerie.pipeline.makers.rendering import RenderMaker
from valerie.pipeline.workers import Presence, consume, queues_of, render_offers
from valerie.settings import load_settings


def main() -> None:
    """Run until told to stop."""
    settings = load_settings()
    configure_logging(settings)
    offers = render_offers(settings.render_engines.split(","))
    app = create_app(settings)
    child = register(app)

    @worker_process_init.connect(weak=False)
    def open_child(**_: object) -> None:
        context = open_context(settings)
        child.open(context, RenderMaker(context))

    presence = Presence(settings, "render", offers)
    presence.join()
    try:
        consume(app, "render", queues_of(offers))
    finally:
        presence.leave()
