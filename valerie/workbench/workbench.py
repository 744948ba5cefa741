"""Runs and their frames as objects: submit, wait, and read numbers and pictures as arrays."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Mapping
from contextlib import nullcontext
from functools import cached_property
from pathlib import Path
from typing import Final, Self

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from valerie.analysis.findings.findings import Findings
from valerie.analysis.summary.summary import Summary
from valerie.analysis.verdicts.verdicts import RequirementVerdict
from valerie.answers import Progress
from valerie.answers import Run as RunRecord
from valerie.client import ServerUnavailableError
from valerie.errors import UnknownName
from valerie.labels import VOID, to_train_ids
from valerie.local.display import Display, display_of
from valerie.local.spec_files import read_spec
from valerie.measures import Row
from valerie.plain import Json, typed
from valerie.runs.forecasting.plan import Plan
from valerie.runs.products.states import RunState
from valerie.workbench.notebook import frame_html, run_html
from valerie.workbench.sources import RunSource

#: Seconds between two questions for the progress.
POLL: Final = 0.5

#: A spec: the path of its file, or its document.
Spec = str | Path | Mapping[str, Json]


class Workbench:
    """The runs of a server or of a data folder; a context manager.

    Every method may raise `valerie.client.ServerUnavailableError` and, for bad input, `valerie.errors.InvalidInput` or
    `valerie.client.ServerProblemError`, which name field, value and limit.
    """

    def __init__(self, source: RunSource) -> None:
        self._source = source

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the connection."""
        self._source.close()

    def runs(self, *, limit: int = 20) -> list[Run]:
        """Return runs, newest first."""
        return [Run(self._source, record) for record in self._source.runs(limit=limit)]

    def run(self, run_id: str) -> Run:
        """Return a run."""
        return Run(self._source, self._source.run(run_id))

    def plan(self, spec: Spec) -> Plan:
        """Return the size and cost of a spec; stores nothing."""
        return self._source.plan(_text(spec))

    def submit(self, spec: Spec) -> Run:
        """Start a run.

        Raises:
            ServerUnavailableError: no server works on the data folder.
        """
        return Run(self._source, self._source.submit(_text(spec)))


class Run:
    """A run.

    Attributes:
        id, name: of the run.
    """

    def __init__(self, source: RunSource, record: RunRecord) -> None:
        self._source = source
        self.id, self.name = record.id, record.name

    def __repr__(self) -> str:
        return f"<run {self.id}: {self.name}, {self.progress().state}>"

    def _repr_html_(self) -> str:
        progress = self.progress()
        ended = _has_results(progress)
        return run_html(
            self.id, self.name, progress, self.summary() if ended else None, self.findings() if ended else None
        )

    def progress(self) -> Progress:
        """Return the state of the run and of its stages."""
        return self._source.progress(self.id)

    def wait(self, *, progress: bool = False) -> Self:
        """Wait until the run has ended, and return it.

        Args:
            progress: True to show it on standard error.

        Raises:
            ServerUnavailableError: the run has not ended, and no server works on the data folder.
        """
        for _ in self.until_ended(progress=progress):
            time.sleep(POLL)
        return self

    def until_ended(self, *, progress: bool = False) -> Iterator[Progress]:
        """Yield the present progress until the run has ended; see `wait`."""
        display: Display | None = display_of(self.name, self.id, json_lines=False) if progress else None
        with display or nullcontext():
            while True:
                current = self.progress()
                if display is not None:
                    display.update(current)
                if RunState(current.state).is_final:
                    return
                if not self._source.works:
                    raise ServerUnavailableError(f"run {self.id} is {current.state}: {current.reason}")
                yield current

    def rows(self, where: str = "") -> pa.Table:
        """Return the long table, one row per person in an evaluation; ``.to_pandas()`` makes it a frame of pandas.

        Args:
            where: an expression such as ``distance_m > 25 and pacc < 0.5``; empty: all rows.

        Raises:
            InvalidInput: the expression is wrong; a server's answer is a `ServerProblemError`.
        """
        return self._source.rows(self.id, where)

    def frames(self, where: str = "") -> list[Frame]:
        """Return sensor and frame of every row that satisfies an expression, each once, in the order of the rows."""
        rows = self.rows(where)
        of_frames: dict[tuple[str, str], list[int]] = {}
        names = zip(rows["frame_id"].to_pylist(), rows["sensor"].to_pylist(), strict=True)
        for number, name in enumerate(names):
            of_frames.setdefault(name, []).append(number)
        return [Frame(self._source, *name, rows.take(numbers)) for name, numbers in of_frames.items()]

    def summary(self) -> Summary:
        """Return the table of an ended run: means, spreads and their intervals."""
        return typed(Summary, self._source.summary(self.id).summary)

    def findings(self) -> Findings:
        """Return the confirmed differences of an ended run, and its candidates."""
        return typed(Findings, self._source.summary(self.id).findings)

    def verdicts(self) -> tuple[RequirementVerdict, ...]:
        """Return the verdicts of an ended run on its requirements."""
        return typed(tuple[RequirementVerdict, ...], self._source.summary(self.id).verdicts)

    def report(self) -> str:
        """Return the report of an ended run, a self-contained HTML page."""
        return self._source.report(self.id).decode()


class Frame:
    """A frame behind one sensor, with the rows that chose it. Arrays are read when they are asked for.

    Attributes:
        id: of the frame, ``run.variant.camera.time``.
        sensor: name of the sensor.
        rows: the chosen rows of the long table.
    """

    def __init__(self, source: RunSource, frame_id: str, sensor: str, rows: pa.Table) -> None:
        self._source = source
        self.id, self.sensor, self.rows = frame_id, sensor, rows

    def __repr__(self) -> str:
        return f"<frame {self.id}, sensor {self.sensor}>"

    def _repr_html_(self) -> str:
        rows: list[Row] = self.rows.to_pylist()
        return frame_html(self.id, self.sensor, self.picture, rows)

    @cached_property
    def functions(self) -> tuple[str, ...]:
        """The functions of the chosen rows, sorted."""
        return tuple(sorted({name for name in self.rows["function"].to_pylist() if name is not None}))

    @cached_property
    def picture(self) -> NDArray[np.uint8]:
        """The picture that the functions see: (H, W, 3) uint8 sRGB."""
        return self._source.picture(self.id, self.sensor)

    @cached_property
    def truth(self) -> NDArray[np.uint8]:
        """The label ids of Cityscapes as the sensor sees them (24 is a person): (H, W) uint8."""
        return self._source.labels(self.id, None, self.sensor)

    def prediction(self, function: str) -> NDArray[np.uint8]:
        """Return the label ids that a function predicts: (H, W) uint8; 0 where it predicts none.

        Raises:
            UnknownName: the rows name no such function.
        """
        if function not in self.functions:
            raise UnknownName("function", function, self.functions, field="function")
        return self._source.labels(self.id, function, self.sensor)

    def errors(self, function: str) -> NDArray[np.bool_]:
        """Return where a function is wrong: (H, W) bool. Pixels whose truth is void are never wrong.

        Raises:
            UnknownName: the rows name no such function.
        """
        truth = to_train_ids(self.truth)
        wrong: NDArray[np.bool_] = (to_train_ids(self.prediction(function)) != truth) & (truth != VOID)
        return wrong


def _has_results(progress: Progress) -> bool:
    return progress.state in (RunState.COMPLETED, RunState.COMPLETED_WITH_FAILURES)


def _text(spec: Spec) -> bytes:
    return json.dumps(spec).encode() if isinstance(spec, Mapping) else read_spec(Path(spec))
