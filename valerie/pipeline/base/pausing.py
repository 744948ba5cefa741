"""Pause runs while no result can be stored; the control loop resumes them."""

from __future__ import annotations

from typing import Final

from valerie.db import runs
from valerie.db.engine import writing
from valerie.errors import ValerieError
from valerie.pipeline.base.context import Context
from valerie.runs.products.states import RunState

#: Beginning of the reason of a pause that ends automatically.
STORAGE_REASON: Final = "storage: "


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
