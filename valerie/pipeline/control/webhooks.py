"""Tell the operator's receivers of each ended run, with signed requests (Standard Webhooks 1.0.0, https://www.standardwebhooks.com).

A receiver hears of an ending at least once. A repetition has the same id, time and body. Failed requests are repeated, less and
less often, for a day.
"""

from __future__ import annotations

import base64
import hashlib
import hmac
import time
from datetime import UTC, datetime, timedelta
from typing import Final, Literal

import structlog
from pydantic import BaseModel, ConfigDict

from valerie.addresses import allowed_target, parse_url
from valerie.db import deliveries
from valerie.db.deliveries import RunEnding
from valerie.db.engine import database_time, reading, writing
from valerie.errors import InvalidInput, NoAnswer
from valerie.outbound import post
from valerie.pipeline.base.context import Context
from valerie.runs.moments import Moment
from valerie.runs.products.states import RunState
from valerie.settings import Settings

log = structlog.get_logger()

_DAY_SECONDS: Final = 86_400.0
_TIMEOUT_SECONDS: Final = 5.0
#: Pauses between attempts double from the first to the longest, seconds.
_FIRST_PAUSE, _LONGEST_PAUSE = 5.0, 3_600.0
#: Endings that a receiver is told of before another one has its turn.
_TURN: Final = 50


class _Ended(BaseModel):
    """A run that ended."""

    model_config = ConfigDict(frozen=True)

    run: str
    name: str
    state: RunState
    reason: str | None
    owner: str | None


class _Message(BaseModel):
    """The body of a webhook."""

    model_config = ConfigDict(frozen=True)

    type: Literal["run.ended"] = "run.ended"
    timestamp: Moment
    data: _Ended


def deliver(context: Context) -> None:
    """Tell each receiver of the endings that are due. A receiver that fails is left alone until the next call."""
    settings = context.settings
    for url in settings.webhook_urls:
        with reading(context.engine) as connection:
            now = database_time(connection)
            endings = deliveries.due(connection, receiver_of(url), since=_earliest(now), now=now, limit=_TURN)
        for ending in endings:
            problem = _tell(settings, url, ending)
            pause = min(_FIRST_PAUSE * 2.0**ending.attempts, _LONGEST_PAUSE)
            with writing(context.engine) as connection:
                due_at = None if problem is None else database_time(connection) + pause
                deliveries.note(connection, ending, receiver_of(url), due_at=due_at, problem=problem)
            if problem is not None:
                log.warning("webhooks.failed", run=ending.id, reason=problem, again_in_seconds=pause)
                break


def undelivered(context: Context) -> dict[str, list[str]]:
    """Return, by the host of each receiver, why it has not heard of endings of the last day; latest first."""
    with reading(context.engine) as connection:
        since = _earliest(database_time(connection))
        return {
            parse_url(url)[0]: deliveries.problems(connection, receiver_of(url), since=since)
            for url in context.settings.webhook_urls
        }


def receiver_of(url: str) -> str:
    """Return the name of a receiver in the database: the SHA-256 of its URL, which may contain a secret."""
    return hashlib.sha256(url.encode()).hexdigest()


def signature_headers(key: bytes, message_id: str, sent_at: int, body: bytes) -> dict[str, str]:
    """Return the headers of Standard Webhooks: id, time in Unix seconds, and HMAC-SHA256 of both and the body."""
    signed = b".".join((message_id.encode(), str(sent_at).encode(), body))
    signature = base64.b64encode(hmac.digest(key, signed, "sha256")).decode()
    return {"webhook-id": message_id, "webhook-timestamp": str(sent_at), "webhook-signature": f"v1,{signature}"}


def _tell(settings: Settings, url: str, ending: RunEnding) -> str | None:
    """Send one message; return why it was not accepted, if it was not."""
    ended_at = ending.finished_at
    data = _Ended(run=ending.id, name=ending.name, state=ending.state, reason=ending.reason, owner=ending.owner)
    body = _Message(timestamp=ended_at, data=data).model_dump_json().encode()
    message_id = hashlib.sha256(f"{ending.id} {ended_at.isoformat()} {url}".encode()).hexdigest()[:32]
    headers = signature_headers(settings.webhook_key, f"msg_{message_id}", int(time.time()), body)
    headers["Content-Type"] = "application/json"
    try:
        target = allowed_target(
            url, settings.webhook_hosts, field="VALERIE_WEBHOOKS", setting="VALERIE_WEBHOOK_NETWORKS", public=True
        )
        post(target, body, headers, timeout_s=_TIMEOUT_SECONDS, limit=0, statuses=range(200, 300))
    except (InvalidInput, NoAnswer) as error:
        return str(error)
    return None


def _earliest(now: float) -> datetime:
    return datetime.fromtimestamp(now, UTC) - timedelta(seconds=_DAY_SECONDS)
