"""The inference worker: offers functions under test and inference engines that run on this machine, and makes predictions."""

from __future__ import annotations

from typing import Final

from services.infer_worker.tasks import register
from valerie import plugins
from valerie.errors import UnknownName
from valerie.logs import configure_logging
from valerie.perception.limits import limit_memory
from valerie.pipeline.context import Context
from valerie.pipeline.makers.inference import InferMaker
from valerie.pipeline.probe import inference_names
from valerie.pipeline.workers import infer_offers, serve
from valerie.settings import load_settings

#: No registered functions here.
_NO_ENGINE: Final = "none"


def _engines(chosen: str) -> tuple[str, ...]:
    known = inference_names()
    if chosen in ("", _NO_ENGINE):
        return () if chosen else known
    names = tuple(name.strip() for name in chosen.split(","))
    for name in names:
        if name not in known:
            raise UnknownName("inference engine", name, known, field="VALERIE_INFER_ENGINES")
    return names


def main() -> None:
    """Run until told to stop."""
    settings = load_settings()
    configure_logging(settings)
    functions = settings.infer_functions.split(",") if settings.infer_functions else plugins.function_names()
    engines = _engines(settings.infer_engines)

    def open_maker(context: Context) -> InferMaker:
        limit_memory(settings.infer_memory_mb)
        return InferMaker(context)

    serve(settings, "infer", offers=infer_offers(functions, engines), register=register, open_maker=open_maker)
