"""The inference worker: offers functions under test and inference engines that run on this machine, and makes predictions."""

from __future__ import annotations

from services.infer_worker.tasks import register
from valerie import plugins
from valerie.logs import configure_logging
from valerie.perception.limits import limit_memory
from valerie.pipeline.context import Context
from valerie.pipeline.makers.inference import InferMaker
from valerie.pipeline.probe import inference_names
from valerie.pipeline.workers import infer_offers, serve
from valerie.settings import load_settings

_NO_ENGINE = "none"


def main() -> None:
    """Run until told to stop."""
    settings = load_settings()
    configure_logging(settings)
    functions = settings.infer_functions.split(",") if settings.infer_functions else plugins.function_names()
    engines = settings.infer_engines.split(",") if settings.infer_engines else inference_names()
    if settings.infer_engines == _NO_ENGINE:
        engines = ()

    def open_maker(context: Context) -> InferMaker:
        limit_memory(settings.infer_memory_mb)
        return InferMaker(context)

    serve(settings, "infer", offers=infer_offers(functions, engines), register=register, open_maker=open_maker)
