"""Points in time as people read them."""

from datetime import UTC, datetime, timedelta, timezone

import pytest

from valerie.runs.moments import in_utc, moment_text


def test_every_moment_is_shown_in_utc_and_says_so() -> None:
    berlin = timezone(timedelta(hours=1))
    assert moment_text(datetime(2026, 11, 21, 15, 5, 59, tzinfo=berlin)) == "2026-11-21 14:05 UTC"


def test_what_a_database_without_time_zones_gives_back_is_utc() -> None:
    assert in_utc(datetime(2026, 11, 21, 14, 5)) == datetime(2026, 11, 21, 14, 5, tzinfo=UTC)  # noqa: DTZ001


def test_a_moment_that_no_calendar_has_in_utc_is_refused() -> None:
    with pytest.raises(ValueError, match="outside the years 1 to 9999"):
        in_utc(datetime(9999, 12, 31, 23, tzinfo=timezone(timedelta(hours=-5))))
