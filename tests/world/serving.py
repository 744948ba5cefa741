"""The real application behind a real server on loopback, in a thread of the test's process."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import httpx
import uvicorn
from starlette.types import ASGIApp

from services.api.connections import HEAD_SECONDS, Connection, limited


@contextmanager
def served(
    app: ASGIApp,
    *,
    token: str | None = None,
    head_seconds: int = HEAD_SECONDS,
    unread_seconds: float = Connection.unread_seconds,
) -> Iterator[httpx.Client]:
    """A client of the application; start-up errors are raised here."""
    # asyncio sends small segments at once only on sockets that name their protocol, as uvicorn's own do.
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    listener.bind(("127.0.0.1", 0))
    listener.listen()
    server = uvicorn.Server(
        uvicorn.Config(
            app,
            http=limited(unread_seconds),
            proxy_headers=False,
            timeout_keep_alive=head_seconds,
            log_config=None,
            access_log=False,
            lifespan="on",
            timeout_graceful_shutdown=5,
        )
    )
    thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]}, daemon=True)
    thread.start()
    try:
        while not server.started:
            if not thread.is_alive():
                raise RuntimeError("the server did not start")
            time.sleep(0.01)
        url = f"http://127.0.0.1:{listener.getsockname()[1]}"
        headers = {"Authorization": f"Bearer {token}"} if token else {}
        with httpx.Client(base_url=url, headers=headers, timeout=30.0, trust_env=False) as client:
            yield client
    finally:
        server.should_exit = True
        thread.join(timeout=10)
        listener.close()


def every_item(client: httpx.Client, path: str, *, limit: int, **parameters: Any) -> list[dict[str, Any]]:
    """Return the items of all pages of a list, ``limit`` a page."""
    items: list[dict[str, Any]] = []
    cursor: dict[str, str] = {}
    while True:
        answer = client.get(path, params={"limit": limit, **parameters, **cursor})
        assert answer.status_code == 200, answer.text
        page = answer.json()
        items += page["items"]
        if page["next"] is None:
            assert page.get("total", len(items)) == len(items)
            return items
        cursor = {"cursor": page["next"]}
