"""The inference worker: offers the functions under test that run on this machine and makes predictions."""

from __future__ import annotations

from services.infer_worker.tasks import register
from valerie import plugins
from valerie.logs import configure_logging
from valerie.pipeline.makers.inference import InferMaker
from valerie.pipeline.workers import infer_offers, serve
from valerie.settings import load_settings


def main() -> None:
    """Run until told to stop."""
    settings = load_settings()
    configure_logging(settings)
    chosen = settings.infer_functions.split(",") if settings.infer_functions else plugins.function_names()
    serve(settings, "infer", offers=infer_offers(chosen), register=register, open_maker=InferMaker)
