"""A server of label maps on this machine that does what each test wants, and remembers what it was asked."""

from __future__ import annotations

import threading
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from io import BytesIO

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from valerie.perception.running.label_png import encode_png


def dark_is_one(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return (picture.max(axis=2) < 40).astype(np.uint8)


class Server:
    """Answers each POST with `answer(handler, picture)`; by default the label map of `dark_is_one`."""

    def __init__(self) -> None:
        self.requests: list[tuple[str, dict[str, str]]] = []
        self.answer: Callable[[BaseHTTPRequestHandler, NDArray[np.uint8]], None] = self.good
        outer = self

        class Handler(BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"

            def do_POST(self) -> None:
                body = self.rfile.read(int(self.headers["Content-Length"]))
                outer.requests.append((self.path, dict(self.headers)))
                outer.answer(self, np.asarray(Image.open(BytesIO(body))))

            def log_message(self, *_: object) -> None:
                pass

        self._server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self._server.daemon_threads = True
        self._server.block_on_close = False
        self.url = f"http://127.0.0.1:{self._server.server_port}/predict?m=1"
        threading.Thread(target=self._server.serve_forever, kwargs={"poll_interval": 0.02}, daemon=True).start()

    def good(self, handler: BaseHTTPRequestHandler, picture: NDArray[np.uint8]) -> None:
        self.send(handler, encode_png(dark_is_one(picture)))

    def send(self, handler: BaseHTTPRequestHandler, body: bytes, status: int = 200, **headers: str) -> None:
        handler.send_response(status)
        named = {name.replace("_", "-"): value for name, value in headers.items()}
        for name, value in {"Content-Length": str(len(body)), **named}.items():
            handler.send_header(name, value)
        handler.end_headers()
        handler.wfile.write(body)

    def close(self) -> None:
        self._server.shutdown()
        self._server.server_close()
