"""Pause runs while no result can be stored or a quota is used up; the control loop resumes them."""

from __future__ import annotations

from typing import Final

from valerie.db import runs
from valerie.db.engine import writing
from valerie.errors import ValerieError
from valerie.pipeline.base.context import Context
from valerie.runs.products.states import RunState

#: Beginnings of the reasons of pauses that end automatically.
STORAGE_REASON: Final = "storage: "
QUOTA_REASON: Final = "quota: "


def pause_for_storage(context: Context, error: ValerieError) -> None:
    """Pause every run that stores products or results, with ``error`` as the reason."""
    storing = (RunState.RUNNING, RunState.FINISHING)
    with writing(context.engine) as connection:
        for run in runs.in_states(connection, storing):
            runs.change_state(
                connection,
                run.id,
                expected=storing,
                state=RunState.PAUSED,
                reason=f"{STORAGE_REASON}{error}",
            )
