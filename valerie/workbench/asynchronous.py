"""The workbench for ``await``: each question is asked in a thread, so that the event loop goes on."""

from __future__ import annotations

import asyncio
from types import TracebackType
from typing import Self

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from valerie.analysis.findings.findings import Findings
from valerie.analysis.summary.summary import Summary
from valerie.analysis.verdicts.verdicts import RequirementVerdict
from valerie.answers import Progress
from valerie.runs.forecasting.plan import Plan
from valerie.workbench.workbench import POLL, Frame, Run, Spec, Workbench


class AsyncWorkbench:
    """`Workbench` for ``await``; an asynchronous context manager."""

    def __init__(self, workbench: Workbench) -> None:
        self._workbench = workbench

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await asyncio.to_thread(self._workbench.close)

    async def runs(self, *, limit: int = 20) -> list[AsyncRun]:
        """Return runs, newest first."""
        return [AsyncRun(run) for run in await asyncio.to_thread(self._workbench.runs, limit=limit)]

    async def run(self, run_id: str) -> AsyncRun:
        """Return a run."""
        return AsyncRun(await asyncio.to_thread(self._workbench.run, run_id))

    async def plan(self, spec: Spec) -> Plan:
        """Return the size and cost of a spec."""
        return await asyncio.to_thread(self._workbench.plan, spec)

    async def submit(self, spec: Spec) -> AsyncRun:
        """Start a run."""
        return AsyncRun(await asyncio.to_thread(self._workbench.submit, spec))


class AsyncRun:
    """`Run` for ``await``.

    Attributes:
        id, name: of the run.
    """

    def __init__(self, run: Run) -> None:
        self._run = run
        self.id, self.name = run.id, run.name

    async def progress(self) -> Progress:
        """Return the state of the run and of its stages."""
        return await asyncio.to_thread(self._run.progress)

    async def wait(self, *, progress: bool = False) -> Self:
        """Wait until the run has ended, and return it; arguments and errors as of `Run.wait`. It can be cancelled."""
        looks = self._run.until_ended(progress=progress)
        while True:
            if await asyncio.to_thread(next, looks, None) is None:
                return self
            await asyncio.sleep(POLL)

    async def rows(self, where: str = "") -> pa.Table:
        """Return the long table, or the rows for which an expression holds."""
        return await asyncio.to_thread(self._run.rows, where)

    async def frames(self, where: str = "") -> list[AsyncFrame]:
        """Return the frames with a row for which an expression holds."""
        return [AsyncFrame(frame) for frame in await asyncio.to_thread(self._run.frames, where)]

    async def findings(self) -> Findings:
        """Return the confirmed differences of an ended run, and its candidates."""
        return await asyncio.to_thread(self._run.findings)

    async def summary(self) -> Summary:
        """Return the table of an ended run."""
        return await asyncio.to_thread(self._run.summary)

    async def verdicts(self) -> tuple[RequirementVerdict, ...]:
        """Return the verdicts of an ended run on its requirements."""
        return await asyncio.to_thread(self._run.verdicts)

    async def report(self) -> str:
        """Return the report of an ended run, an HTML page."""
        return await asyncio.to_thread(self._run.report)


class AsyncFrame:
    """`Frame` for ``await``.

    Attributes:
        id, sensor, rows, functions: as of `Frame`.
    """

    def __init__(self, frame: Frame) -> None:
        self._frame = frame
        self.id, self.sensor, self.rows, self.functions = frame.id, frame.sensor, frame.rows, frame.functions

    async def picture(self) -> NDArray[np.uint8]:
        """Return the picture that the functions are given: (H, W, 3) uint8 sRGB."""
        return await asyncio.to_thread(lambda: self._frame.picture)

    async def truth(self) -> NDArray[np.uint8]:
        """Return the label ids as the sensor sees them: (H, W) uint8."""
        return await asyncio.to_thread(lambda: self._frame.truth)

    async def prediction(self, function: str) -> NDArray[np.uint8]:
        """Return the label ids that a function predicts: (H, W) uint8."""
        return await asyncio.to_thread(self._frame.prediction, function)

    async def errors(self, function: str) -> NDArray[np.bool_]:
        """Return where a function is wrong: (H, W) bool."""
        return await asyncio.to_thread(self._frame.errors, function)
