"""Answers about the API's tokens."""

from __future__ import annotations

from pydantic import Field

from services.api.schemas.base import Read
from valerie.access import Role
from valerie.runs.moments import Moment


class TokenRead(Read):
    """A token without its secret."""

    name: str = Field(examples=["nightly"])
    owner: str = Field(examples=["Ada Lovelace"])
    role: Role = Field(examples=["runner"])
    created_at: Moment = Field(examples=["2026-11-21T02:43:08Z"])
    expires_at: Moment = Field(examples=["2027-02-19T02:43:08Z"])
    revoked_at: Moment | None
    used_at: Moment | None = Field(description="last request, to the minute")


class TokenIssued(TokenRead):
    """A new token with its secret, which cannot be read again."""

    secret: str = Field(description="bearer token; shown only here", examples=["valerie_3q2-7wAA"])
