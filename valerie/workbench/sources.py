"""The two places that answer questions about runs: a server, and a data folder."""

from __future__ import annotations

import io
from collections.abc import Iterable
from typing import TYPE_CHECKING, Protocol

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from PIL import Image

from valerie.answers import Progress, Run, RunSummary
from valerie.client import Client, ServerUnavailableError
from valerie.local.folder import Folder
from valerie.runs.forecasting.plan import Plan

if TYPE_CHECKING:
    from valerie.pipeline.base.context import Context


class RunSource(Protocol):
    """Answers questions about runs. Every method may raise a `valerie.errors.ValerieError`.

    Attributes:
        works: True if somebody works on the runs.
    """

    works: bool

    def runs(self, *, limit: int) -> Iterable[Run]:
        """Return runs, newest first."""
        ...

    def run(self, run_id: str) -> Run:
        """Return a run."""
        ...

    def progress(self, run_id: str) -> Progress:
        """Return the progress of a run."""
        ...

    def summary(self, run_id: str) -> RunSummary:
        """Return summary, findings and verdicts of an ended run."""
        ...

    def report(self, run_id: str) -> bytes:
        """Return the HTML report of an ended run."""
        ...

    def plan(self, spec: bytes) -> Plan:
        """Return the size and cost of a spec."""
        ...

    def submit(self, spec: bytes) -> Run:
        """Start a run."""
        ...

    def rows(self, run_id: str, where: str) -> pa.Table:
        """Return the rows of the long table for which an expression holds."""
        ...

    def picture(self, frame_id: str, sensor: str | None) -> NDArray[np.uint8]:
        """Return a picture, (H, W, 3) uint8 sRGB."""
        ...

    def labels(self, frame_id: str, function: str | None, sensor: str | None) -> NDArray[np.uint8]:
        """Return the label ids of the truth, or of a function's prediction, (H, W) uint8."""
        ...

    def close(self) -> None:
        """Close the connection."""
        ...


class Served:
    """The runs of a server."""

    works = True

    def __init__(self, client: Client) -> None:
        self._client = client
        self.runs, self.run, self.progress = client.runs, client.run, client.progress
        self.summary, self.report = client.summary, client.report
        self.plan, self.close = client.plan, client.close

    def submit(self, spec: bytes) -> Run:
        """Start a run."""
        return self._client.submit(spec)

    def rows(self, run_id: str, where: str) -> pa.Table:
        """Return the rows of the long table for which an expression holds."""
        return pa.ipc.open_stream(self._client.rows(run_id, where)).read_all()

    def picture(self, frame_id: str, sensor: str | None) -> NDArray[np.uint8]:
        """Return a picture, (H, W, 3) uint8 sRGB."""
        return _pixels(self._client.picture(frame_id, sensor=sensor))

    def labels(self, frame_id: str, function: str | None, sensor: str | None) -> NDArray[np.uint8]:
        """Return the label ids of the truth, or of a function's prediction, (H, W) uint8."""
        return _pixels(self._client.labels(frame_id, function=function, sensor=sensor))


class StoredRuns:
    """The runs of a data folder on which no server works."""

    works = False

    def __init__(self, context: Context, up: str) -> None:
        """Read from an open deployment.

        Args:
            context: of the deployment.
            up: the command line that starts a server on the folder.
        """
        from valerie.pipeline.exploring.exploration_cache import Explorations

        self._context, self._up = context, up
        self._explorations = Explorations(context)
        folder = Folder(context, up)
        self.runs, self.run, self.progress = folder.runs, folder.run, folder.progress
        self.summary, self.report = folder.summary, folder.report

    def plan(self, spec: bytes) -> Plan:
        """Return the size and cost of a spec."""
        from valerie.pipeline.control.planning import plan_run
        from valerie.runs.resolving.spec import parse

        return plan_run(self._context, parse(spec))

    def submit(self, spec: bytes) -> Run:
        """Refuse to start a run, since nobody would work on it; what is wrong with the spec comes first."""
        self.plan(spec)
        raise ServerUnavailableError(f"no server runs on the data folder; start one with `{self._up}`")

    def rows(self, run_id: str, where: str) -> pa.Table:
        """Return the rows of the long table for which an expression holds."""
        exploration = self._explorations.open([run_id])
        return exploration.rows(exploration.select(where))

    def picture(self, frame_id: str, sensor: str | None) -> NDArray[np.uint8]:
        """Return a picture, (H, W, 3) uint8 sRGB."""
        from valerie.pipeline.reading.frame_pictures import find_picture, paint_picture
        from valerie.runs.products.frame_keys import FrameKey

        key = FrameKey.parse(frame_id)
        return paint_picture(self._context, find_picture(self._context, key, kind="picture", sensor=sensor))

    def labels(self, frame_id: str, function: str | None, sensor: str | None) -> NDArray[np.uint8]:
        """Return the label ids of the truth, or of a function's prediction, (H, W) uint8."""
        from valerie.pipeline.reading.frame_pictures import find_picture, label_map
        from valerie.runs.products.frame_keys import FrameKey

        kind = "truth" if function is None else "prediction"
        key = FrameKey.parse(frame_id)
        source = find_picture(self._context, key, kind=kind, function=function, sensor=sensor)
        return label_map(self._context, source)

    def close(self) -> None:
        """Close the database."""
        self._context.engine.dispose()


def _pixels(png: bytes) -> NDArray[np.uint8]:
    with Image.open(io.BytesIO(png), formats=["PNG"]) as image:
        return np.array(image, np.uint8)
