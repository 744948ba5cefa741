"""Deadlines of runs that wait for uploaded predictions (see `valerie.pipeline.work.uploaded_predictions`)."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any, Final

from valerie.runs.moments import moment_text
from valerie.settings import Settings

_KIND: Final = "predictions"
#: What the reason of a run that waits for people begins with.
AWAITING: Final = "awaiting-predictions"


def with_deadlines(pins: Mapping[str, Any], settings: Settings, now: float) -> dict[str, Any]:
    """Pins of a run that starts (again) now: its user has the whole time from here on."""
    dated = {}
    for name, pin in pins["functions"].items():
        dated[name] = pin
        if pin.get("kind") == _KIND:
            hours = pin["deadline_hours"] or settings.predictions_hours
            dated[name] = {**pin, "deadline": now + hours * 3600}
    return {**pins, "functions": dated}


def deadlines(pins: Mapping[str, Any] | None) -> dict[str, float]:
    """Return the deadline, in Unix seconds, of each function whose predictions are uploaded."""
    if pins is None:
        return {}
    return {name: pin["deadline"] for name, pin in pins["functions"].items() if pin.get("kind") == _KIND}


def until(deadline: float) -> str:
    """A deadline for people: ``2026-11-21 14:05 UTC``."""
    return moment_text(datetime.fromtimestamp(deadline, UTC))


def awaiting_reason(count: int, pins: Mapping[str, Any] | None) -> str | None:
    """Why a run does not go on by itself; None where it waits for nobody."""
    ends = deadlines(pins).values()
    if not count or not ends:
        return None
    return f"{AWAITING}: {count} predictions are to be uploaded by {until(min(ends))}"
