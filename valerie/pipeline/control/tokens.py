"""Issue, revoke and check the API's tokens."""

from __future__ import annotations

from datetime import timedelta
from secrets import token_hex
from typing import Annotated, Final, Self

import structlog
from pydantic import Field, model_validator

from valerie.access import PROJECT, Area, Caller, Role, digest_of, new_secret
from valerie.db import tokens
from valerie.db.engine import database_moment, reading, writing
from valerie.document import Document
from valerie.errors import InvalidInput, TransientError
from valerie.pipeline.base.context import Context

log = structlog.get_logger()

NAME: Final = r"^[a-z0-9][a-z0-9._-]{0,63}$"
#: A write per request would cost more than most requests.
_USE_INTERVAL: Final = timedelta(minutes=1)


class TokenRequest(Document):
    """A token to be issued.

    Attributes:
        name: identifies the token.
        owner: person or service that holds it.
        role: its rights.
        project: the only one that exists for it; empty: all do, as for each admin.
        scopes: areas of the API that it reaches; none: all.
        days: until it expires.
    """

    name: Annotated[str, Field(pattern=NAME, examples=["nightly"])]
    owner: Annotated[str, Field(pattern=r"^[^\x00-\x1f\x7f]{1,200}$", examples=["Ada Lovelace"])]
    role: Annotated[Role, Field(examples=["runner"])] = Role.VIEWER
    project: Annotated[str, Field(pattern=f"{PROJECT}|^$", examples=["radar"])] = ""
    scopes: Annotated[frozenset[Area], Field(examples=[["metrics"]])] = frozenset()
    days: Annotated[int, Field(ge=1, le=3650, examples=[90])] = 90

    @model_validator(mode="after")
    def _admin_of_all(self) -> Self:
        if self.role is Role.ADMIN and self.project:
            raise InvalidInput(
                "an admin manages the tokens of all projects", field="project", value=self.project, limit="none"
            )
        return self


def issue(context: Context, request: TokenRequest) -> tuple[tokens.TokenRow, str]:
    """Store a new token; return it and its secret, which is stored nowhere.

    Raises:
        Conflict: a token has or had this name.
    """
    return _issue(
        context,
        request.name,
        request.owner,
        request.role,
        timedelta(days=request.days),
        project=request.project,
        scopes=tuple(sorted(request.scopes)),
    )


def issue_to(context: Context, owner: str, role: Role, project: str, *, hours: float) -> tuple[tokens.TokenRow, str]:
    """Store a token under a new name for someone who signed in; return it and its secret, which is stored nowhere."""
    return _issue(context, f"sign-in-{token_hex(8)}", owner, role, timedelta(hours=hours), project=project)


def _issue(
    context: Context,
    name: str,
    owner: str,
    role: Role,
    time: timedelta,
    *,
    project: str,
    scopes: tuple[str, ...] = (),
) -> tuple[tokens.TokenRow, str]:
    secret = new_secret()
    with writing(context.engine) as connection:
        now = database_moment(connection)
        token = tokens.TokenRow(name, owner, role, now, now + time, project=project, scopes=scopes)
        tokens.create(connection, token, digest_of(secret))
    return token, secret


def revoke(context: Context, name: str) -> None:
    """Revoke a token at once.

    Raises:
        NotFound: no such token.
    """
    with writing(context.engine) as connection:
        tokens.revoke(connection, name, database_moment(connection))


def caller_of(context: Context, secret: str) -> Caller | None:
    """Return the caller whose token has this secret; None if there is none, or it expired or was revoked.

    Raises:
        TransientError: the database does not answer.
    """
    with reading(context.engine) as connection:
        now = database_moment(connection)
        token = tokens.valid(connection, digest_of(secret), now)
    if token is None:
        return None
    if token.used_at is None or now - token.used_at >= _USE_INTERVAL:
        try:
            with writing(context.engine) as connection:
                tokens.touch(connection, token.name, now)
        except TransientError as error:  # a full disk must not lock everybody out
            log.warning("token.use_not_recorded", token=token.name, reason=str(error))
    return Caller(token.name, token.owner, token.role, token.project, token.scopes)
