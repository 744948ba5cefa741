"""Start the API with the control loop: `python -m services.api`; ``--control-only`` starts only the loop."""

from __future__ import annotations

import argparse
import signal
import sys
import threading

import uvicorn

from services.api.app import create_app
from services.api.connections import HEAD_SECONDS, limited
from valerie.db.migrate import migrate
from valerie.errors import ValerieError
from valerie.logs import configure_logging
from valerie.pipeline.base.context import open_context
from valerie.pipeline.control.loop import ControlLoop
from valerie.settings import load_settings


def main() -> None:
    """Run until a signal ends the process."""
    parser = argparse.ArgumentParser(prog="services.api", description=__doc__)
    group = parser.add_mutually_exclusive_group()
    group.add_argument("--control-only", action="store_true", help="the control loop without the API")
    group.add_argument("--no-control", action="store_true", help="the API without the control loop")
    group.add_argument("--migrate-only", action="store_true", help="migrate the database and exit")
    arguments = parser.parse_args()
    try:
        _run(arguments)
    except ValerieError as error:
        # An operator can fix these: a missing token, a read-only folder, a newer database.
        sys.exit(f"services.api: {error}")


def _run(arguments: argparse.Namespace) -> None:
    settings = load_settings()
    configure_logging(settings)
    if not (arguments.control_only or arguments.migrate_only):
        settings.require_token()
    context = open_context(settings)
    migrate(context.engine)
    if arguments.migrate_only:
        return
    context.store.check()
    if arguments.control_only:
        stop = threading.Event()
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, lambda *_: stop.set())
        ControlLoop(context).run(stop)
        return
    context.engine.dispose()  # the application opens its own engine
    app = create_app(settings, control=not arguments.no_control)
    uvicorn.run(
        app,
        host=settings.api_host,
        port=settings.api_port,
        http=limited(settings.unread_seconds),
        proxy_headers=False,  # the application knows whom to trust
        timeout_keep_alive=HEAD_SECONDS,
        log_config=None,
        access_log=False,
    )


if __name__ == "__main__":
    main()
