"""Deadlines of runs that wait for uploaded predictions (see `valerie.pipeline.work.uploaded_predictions`)."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Final

from valerie.runs.moments import moment_text
from valerie.runs.products.pins import FunctionPin, Pins
from valerie.settings import Settings

_KIND: Final = "predictions"
#: Beginning of the reason of a run that waits for users.
AWAITING: Final = "awaiting-predictions"


def with_deadlines(pins: Pins, settings: Settings, now: float) -> Pins:
    """Return the pins of a run that starts or restarts now, with full time for uploads from ``now`` on."""

    def dated(pin: FunctionPin) -> FunctionPin:
        hours = pin.deadline_hours or settings.predictions_hours
        return pin.model_copy(update={"deadline": now + hours * 3600}) if pin.kind == _KIND else pin

    return pins.model_copy(update={"functions": {name: dated(pin) for name, pin in pins.functions.items()}})


def deadlines(pins: Pins | None) -> dict[str, float]:
    """Return function name to deadline, in Unix seconds, of the functions whose predictions are uploaded."""
    functions = {} if pins is None else pins.functions
    return {name: pin.deadline for name, pin in functions.items() if pin.deadline is not None}


def until(deadline: float) -> str:
    """Return a deadline as text: ``2026-11-21 14:05 UTC``."""
    return moment_text(datetime.fromtimestamp(deadline, UTC))


def awaiting_reason(count: int, pins: Pins | None) -> str | None:
    """Return the reason why a run waits for users; None if it does not."""
    ends = deadlines(pins).values()
    if not count or not ends:
        return None
    return f"{AWAITING}: {count} predictions are to be uploaded by {until(min(ends))}"
