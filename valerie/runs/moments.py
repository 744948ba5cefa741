"""Points in time as people read them: in UTC, and always saying so."""

from __future__ import annotations

from datetime import UTC, datetime


def in_utc(moment: datetime) -> datetime:
    """The same moment in UTC; one without time zone (SQLite keeps none) was written in UTC."""
    return moment.replace(tzinfo=UTC) if moment.tzinfo is None else moment.astimezone(UTC)


def moment_text(moment: datetime) -> str:
    """The one form for people, e.g. ``2026-11-21 14:05 UTC``."""
    return in_utc(moment).strftime("%Y-%m-%d %H:%M UTC")
