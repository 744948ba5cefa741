"""Deadlines of runs that wait for uploaded predictions (see `valerie.pipeline.work.uploaded_predictions`)."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Final

from valerie.runs.moments import moment_text
from valerie.runs.products.pins import FunctionPin, Pins
from valerie.settings import Settings

_KIND: Final = "predictions"
#: The reason of a run that waits for people begins with this.
AWAITING: Final = "awaiting-predictions"


def with_deadlines(pins: Pins, settings: Settings, now: float) -> Pins:
    """Return the pins of a run that starts, or starts again, now: people have the whole time from here on."""

    def dated(pin: FunctionPin) -> FunctionPin:
        hours = pin.deadline_hours or settings.predictions_hours
        return pin.model_copy(update={"deadline": now + hours * 3600}) if pin.kind == _KIND else pin

    return pins.model_copy(update={"functions": {name: dated(pin) for name, pin in pins.functions.items()}})


def deadlines(pins: Pins | None) -> dict[str, float]:
    """Return the deadline, Unix seconds, of each function whose predictions are uploaded, by its name."""
    functions = {} if pins is None else pins.functions
    return {name: pin.deadline for name, pin in functions.items() if pin.deadline is not None}


def until(deadline: float) -> str:
    """Return a deadline for people: ``2026-11-21 14:05 UTC``."""
    return moment_text(datetime.fromtimestamp(deadline, UTC))


def awaiting_reason(count: int, pins: Pins | None) -> str | None:
    """Return why a run waits for people; None where it waits for nobody."""
    ends = deadlines(pins).values()
    if not count or not ends:
        return None
    return f"{AWAITING}: {count} predictions are to be uploaded by {until(min(ends))}"
