"""The control module: REST API, dashboard and, by default, the control loop in a thread of this process."""

from __future__ import annotations

import threading
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from importlib.metadata import PackageNotFoundError, version
from typing import Final

import structlog
from fastapi import Depends, FastAPI, Request
from fastapi.responses import JSONResponse, RedirectResponse
from uvicorn.middleware.proxy_headers import ProxyHeadersMiddleware

from services.api import openapi, problems
from services.api.dashboard_pages import DashboardFiles
from services.api.dependencies import only_declared_queries
from services.api.head import HeadAsGet
from services.api.identity_provider import IdentityProvider
from services.api.projects import require_own
from services.api.protection import Protection
from services.api.roles import require_role
from services.api.routers import (
    access,
    audit,
    catalog,
    drafts,
    explore,
    frames,
    functions,
    health,
    marks,
    predictions,
    results,
    runs,
    sign_in,
    studies,
    tokens,
)
from services.api.scopes import require_scope
from valerie import plugins
from valerie.db.migrate import migrate
from valerie.pipeline.base.context import hurried, open_context
from valerie.pipeline.control.loop import ControlLoop
from valerie.pipeline.control.preview import Previews
from valerie.pipeline.exploring.class_confusion import Confusions
from valerie.pipeline.exploring.exploration_cache import Explorations
from valerie.pipeline.exploring.thumbnails import Tiles
from valerie.pipeline.reading.pixels import Pixels
from valerie.settings import Settings, load_settings

log = structlog.get_logger()

#: Longest statement on Postgres of a request that only reads one page or one thing.
_READ_SECONDS: Final = 10.0

_DESCRIPTION = """
Submit a *run* (a spec as JSON or YAML), follow its progress, read its results. Errors are problem documents (RFC 9457) that
name field, value and limit. Lists are paged by opaque cursors: pass `next` as `cursor` until it is null. Pictures and stored
objects carry an ETag and support Range.
"""


def create_app(settings: Settings | None = None, *, control: bool = True) -> FastAPI:
    """Return the ASGI application.

    Args:
        settings: None: read from the environment.
        control: True runs the control loop too; False if it runs separately (`python -m services.api --control-only`).

    Raises:
        InvalidInput: the server would listen on the network without a token.
        Conflict: a newer version has written the database.
    """
    settings = settings or load_settings()
    settings.require_token()

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        context = open_context(settings)
        migrate(context.engine)
        context.store.check()
        for notice in plugins.look_at_installed():
            log.warning("api.plugins", reason=notice)
        loop = ControlLoop(context) if control else None
        app.state.patient, app.state.control = context, loop
        app.state.context = hurried(context, min(_READ_SECONDS, settings.database_seconds))
        app.state.explorations, app.state.tiles = Explorations(context), Tiles(context)
        app.state.confusions, app.state.pixels = Confusions(context), Pixels(context)
        app.state.identity_provider = IdentityProvider(settings) if settings.oidc_issuer else None
        previews = app.state.previews = Previews(context)
        stop = threading.Event()
        thread = threading.Thread(target=loop.run, args=(stop,), name="control", daemon=True) if loop else None
        if thread is not None:
            thread.start()
        yield
        stop.set()
        previews.close()
        if loop is not None and thread is not None:
            loop.wake()
            thread.join(timeout=10)
        app.state.context.engine.dispose()
        context.engine.dispose()

    app = FastAPI(
        title="VALERIE",
        version=_version(),
        summary="Validation of perception DNNs by systematic variation of synthetic scenes",
        description=_DESCRIPTION,
        lifespan=lifespan,
        dependencies=[Depends(require_scope)],
        # A route of its own, below, is checked as all are.
        openapi_url=None,
        # FastAPI's own pages load their scripts from another host.
        docs_url=None,
        redoc_url=None,
    )
    problems.install(app)
    modules = (
        runs,
        drafts,
        marks,
        studies,
        frames,
        results,
        explore,
        functions,
        predictions,
        catalog,
        access,
        tokens,
        audit,
    )
    routers = [module.router for module in modules]
    openapi.install(app, [*routers, sign_in.router, health.router])
    app.add_middleware(Protection, settings=settings)
    app.add_middleware(HeadAsGet)
    # The last added is the first asked.
    app.add_middleware(ProxyHeadersMiddleware, trusted_hosts=[*settings.proxies])
    for router in routers:
        shared = [Depends(require_role), Depends(require_own), Depends(only_declared_queries)]
        app.include_router(router, dependencies=shared)
    # Probes may add any query parameter.
    app.include_router(health.router)
    app.include_router(sign_in.router)
    app.mount("/dashboard", DashboardFiles(), name="dashboard")

    @app.get("/openapi.json", include_in_schema=False)
    def document() -> JSONResponse:
        return JSONResponse(app.openapi())

    @app.get("/", include_in_schema=False)
    def home() -> RedirectResponse:
        return RedirectResponse("/dashboard/")

    @app.get("/explore", include_in_schema=False)
    def explore_page(request: Request) -> RedirectResponse:
        return RedirectResponse(f"/dashboard/#/explore?{request.url.query}")

    return app


def _version() -> str:
    try:
        return version("valerie")
    except PackageNotFoundError:
        return "0+unknown"
