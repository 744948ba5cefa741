"""The render worker: offers the engines that work on this machine and makes backgrounds, layers and ground truth."""

from __future__ import annotations

from functools import partial

import structlog

from valerie import plugins
from valerie.broker import RENDER
from valerie.logs import configure_logging
from valerie.pipeline.work.child import declare_task
from valerie.pipeline.work.makers.rendering import RenderMaker
from valerie.pipeline.work.workers import render_offers, serve
from valerie.runs.products.states import Stage
from valerie.settings import load_settings

log = structlog.get_logger()


def main() -> None:
    """Run until a signal ends the process."""
    settings = load_settings()
    configure_logging(settings)
    for notice in plugins.look_at_installed():
        log.warning("worker.plugins", reason=notice)
    probe = partial(render_offers, settings.render_engines.split(","))
    serve(settings, Stage.RENDER, probe=probe, register=partial(declare_task, RENDER), open_maker=RenderMaker)
