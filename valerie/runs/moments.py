"""Points in time in UTC, and durations; both as text."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Annotated

from pydantic import AfterValidator


def in_utc(moment: datetime) -> datetime:
    """Return a moment in UTC; one without time zone (SQLite stores none) is assumed to be in UTC.

    Raises:
        ValueError: in UTC, it is not within the years 1 to 9999.
    """
    try:
        return moment.replace(tzinfo=UTC) if moment.tzinfo is None else moment.astimezone(UTC)
    except OverflowError:
        raise ValueError("outside the years 1 to 9999") from None


#: A moment in a document or an answer; in UTC, whatever its time zone was.
Moment = Annotated[datetime, AfterValidator(in_utc)]


def moment_text(moment: datetime) -> str:
    """Return a moment as text, e.g. ``2026-11-21 14:05 UTC``."""
    return in_utc(moment).strftime("%Y-%m-%d %H:%M UTC")


def duration(seconds: float) -> str:
    """Return a duration as text for people: ``42 s``, ``3 min 20 s``, ``5 h 10 min``, ``3 d 4 h``."""
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60} s"
    if whole < 86_400:
        return f"{whole // 3600} h {whole % 3600 // 60} min"
    return f"{whole // 86_400} d {whole % 86_400 // 3600} h"
