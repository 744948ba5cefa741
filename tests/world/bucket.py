"""A real S3 endpoint: moto's server as a process of its own."""

from __future__ import annotations

import os
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def s3_server(folder: Path, **environment: str) -> Iterator[str]:
    """Run a server during the body; give its URL.

    Args:
        folder: for its log.
        environment: further variables of the server.
    """
    log = folder / "log"
    # Port 0 lets the system choose; the server says which in its first lines.
    with log.open("wb") as stream:
        server = subprocess.Popen(
            [sys.executable, "-m", "moto.server", "-H", "127.0.0.1", "-p", "0"],
            stdout=stream,
            stderr=stream,
            env=os.environ | environment,
        )
    try:
        yield _address(log, server)
    finally:
        server.terminate()
        server.wait(10)


def _address(log: Path, server: subprocess.Popen[bytes]) -> str:
    for _ in range(600):
        text = log.read_text()
        if "Running on http://127.0.0.1:" in text:
            url = "http://127.0.0.1:" + text.split("Running on http://127.0.0.1:")[1].split()[0]
            urllib.request.urlopen(url + "/moto-api/", timeout=5).close()
            return url
        assert server.poll() is None, text
        time.sleep(0.05)
    raise AssertionError(f"moto's server did not start: {log.read_text()}")
