"""Answers about the API's tokens and their use."""

from __future__ import annotations

from pydantic import Field

from services.api.schemas.base import Read
from valerie.access import Role
from valerie.runs.moments import Moment


class AccessRead(Read):
    """The rights of a caller."""

    role: Role = Field(examples=["viewer"])
    refused: list[str] = Field(description="endpoints that need another role", examples=[["POST /v1/runs"]])


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


class AuditRead(Read):
    """A row of the audit log: before a change (without a status), or its outcome."""

    number: int = Field(description="counts up; rows are never changed or deleted", examples=[17])
    request: str = Field(description="the same before and after", examples=["5f0c3a9be1d24c77"])
    at: Moment = Field(examples=["2026-11-21T02:43:08Z"])
    caller: str | None = Field(description="name of the token; null without a valid one", examples=["nightly"])
    owner: str | None = Field(examples=["Ada Lovelace"])
    role: Role | None = Field(examples=["runner"])
    address: str = Field(examples=["127.0.0.1"])
    method: str = Field(examples=["DELETE"])
    path: str = Field(examples=["/v1/runs/0abc"])
    status: int | None = Field(description="of the answer", examples=[204])
    left_out: int = Field(description="refusals before this one that were too many to be kept", examples=[0])
