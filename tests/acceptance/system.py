"""A whole system of real processes for tests: Redis, API with control loop, one worker per queue."""

from __future__ import annotations

import hashlib
import io
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Self

import httpx
import psutil
import pyarrow.parquet as pq

from valerie.embedded import running
from valerie.embedded.supervisor import Supervisor
from valerie.settings import load_settings
from valerie.storage.keys import PRODUCTS
from valerie.storage.store import open_store

ENDED = ("completed", "completed-with-failures", "cancelled", "failed")


class Api:
    """A server that tests talk to through a client."""

    def __init__(self, client: httpx.Client) -> None:
        self.client = client

    def submit(self, document: dict[str, Any], **headers: str) -> str:
        answer = self.client.post("/v1/runs", json=document, headers=headers)
        assert answer.status_code == 202, answer.text
        return str(answer.json()["id"])

    def begin(self, document: dict[str, Any]) -> str:
        """Begin a study; return its id."""
        answer = self.client.post("/v1/studies", json=document)
        answer.raise_for_status()
        return str(answer.json()["id"])

    def study(self, study_id: str) -> dict[str, Any]:
        return dict(self._answer(f"/v1/studies/{study_id}").json())

    def progress(self, run_id: str) -> dict[str, Any]:
        return dict(self._answer(f"/v1/runs/{run_id}/progress").json())

    def wait(self, run_id: str, *, until: Callable[[dict[str, Any]], bool] | None = None, seconds: float = 240) -> str:
        """Poll until ``until`` holds (default: the run ended); its state."""
        deadline = time.monotonic() + seconds
        while True:
            progress = self.progress(run_id)
            if progress["state"] in ENDED or (until is not None and until(progress)):
                return str(progress["state"])
            assert time.monotonic() < deadline, progress
            # A moment in the middle of a run is short; for its end, questions are only work for the server.
            time.sleep(0.25 if until is None else 0.05)

    def rows(self, run_id: str) -> list[dict[str, Any]]:
        """The long table without what names the run."""
        data = self._answer(f"/v1/runs/{run_id}/evaluations?format=parquet").content
        table = pq.read_table(io.BytesIO(data))
        return [
            {name: value for name, value in row.items() if name not in ("run_id", "frame_id")}
            for row in table.to_pylist()
        ]

    def _answer(self, path: str) -> httpx.Response:
        """GET with patience: the API may be the process that was killed."""
        deadline = time.monotonic() + 60
        while True:
            try:
                answer = self.client.get(path)
                if answer.status_code < 500:
                    answer.raise_for_status()
                    return answer
            except httpx.TransportError:
                pass
            assert time.monotonic() < deadline, path
            time.sleep(0.2)


class System(Api):
    """Context manager around the one-machine mode."""

    def __init__(self, data_dir: Path, assets: Path, **settings: Any) -> None:
        fast = {"lease_seconds": 3.0, "heartbeat_seconds": 0.5, "sweep_seconds": 0.5, "resend_seconds": 3.0}
        self.settings = load_settings(
            {},
            **{
                "data_dir": data_dir,
                "asset_dir": assets,
                "api_port": 0,
                "testing_engines": True,
                "render_engines": "blank",
                "infer_functions": "blank",
                "infer_engines": "none",
                "visibility_timeout_seconds": 5,
                "shutdown_seconds": 1.0,
                "min_free_mb": 0,
                **fast,
                **settings,
            },
        )
        lock = running.Lock(self.settings.data_dir)
        assert lock.take()
        self.supervisor = Supervisor(self.settings, lock)

    def __enter__(self) -> Self:
        self.supervisor.__enter__()
        super().__init__(httpx.Client(base_url=self.supervisor.url, timeout=30.0))
        return self

    def __exit__(self, *error: Any) -> None:
        self.client.close()
        self.supervisor.__exit__(*error)

    def objects(self) -> dict[str, str]:
        """Key to SHA-256 of every stored product."""
        store = open_store(self.settings.artifacts_url)
        keys = sorted(info.key for info in store.list(PRODUCTS.rstrip("/")))
        return {key: hashlib.sha256(store.get(key)).hexdigest() for key in keys}

    def processes(self, service: str) -> list[psutil.Process]:
        """The process of a service and all below it, children first."""
        parent = psutil.Process(self.supervisor.pids()[service])
        return [*parent.children(recursive=True), parent]

    def computing(self, service: str) -> list[psutil.Process]:
        """The child of a worker that computes."""
        processes = self.processes(service)
        worker = [p for p in processes if p.children() and "multiprocessing" not in " ".join(p.cmdline())]
        return worker[0].children() if worker else processes[:1]
