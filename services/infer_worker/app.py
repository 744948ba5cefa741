"""The inference worker: offers functions under test and inference engines that run on this machine, and makes predictions."""

from __future__ import annotations

from functools import partial
from typing import Final

import structlog

from valerie import plugins
from valerie.broker import INFER
from valerie.errors import UnknownName
from valerie.logs import configure_logging
from valerie.pipeline.functions.probe import inference_names
from valerie.pipeline.work.child import declare_task
from valerie.pipeline.work.makers.inference import InferMaker
from valerie.pipeline.work.workers import infer_offers, serve
from valerie.runs.products.states import Stage
from valerie.settings import load_settings

log = structlog.get_logger()

#: VALERIE_INFER_ENGINES of a worker without registered functions.
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


def _functions(chosen: str) -> tuple[str, ...]:
    if not chosen:
        return plugins.function_names()
    names = tuple(name.strip() for name in chosen.split(","))
    for name in names:
        plugins.require_function(name, field="VALERIE_INFER_FUNCTIONS")
    return names


def main() -> None:
    """Run until a signal ends the process."""
    settings = load_settings()
    configure_logging(settings)
    for notice in plugins.look_at_installed():
        log.warning("worker.plugins", reason=notice)
    probe = partial(infer_offers, _functions(settings.infer_functions), _engines(settings.infer_engines))
    serve(settings, Stage.INFER, probe=probe, register=partial(declare_task, INFER), open_maker=InferMaker)
