"""Points in time as people read them."""

from datetime import UTC, datetime, timedelta, timezone

from valerie.runs.moments import in_utc, moment_text


def test_every_moment_is_shown_in_utc_and_says_so() -> None:
    berlin = timezone(timedelta(hours=1))
    assert moment_text(datetime(2026, 11, 21, 15, 5, 59, tzinfo=berlin)) == "2026-11-21 14:05 UTC"


def test_what_a_database_without_time_zones_gives_back_is_utc() -> None:
    assert in_utc(datetime(2026, 11, 21, 14, 5)) == datetime(2026, 11, 21, 14, 5, tzinfo=UTC)  # noqa: DTZ001
