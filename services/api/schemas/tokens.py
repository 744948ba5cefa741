"""Answers about the API's tokens and their use."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import Field, model_validator

from services.api.schemas.base import Read
from valerie.access import Role
from valerie.document import Document
from valerie.errors import InvalidInput
from valerie.pipeline.control.quotas import Resource
from valerie.runs.moments import Moment


class AccessRead(Read):
    """The rights of a caller."""

    role: Role = Field(examples=["viewer"])
    project: str = Field(description="the only one that exists for it; empty: all do", examples=["radar"])
    scopes: list[str] = Field(description="areas that it reaches; empty: all", examples=[["runs", "results"]])
    refused: list[str] = Field(description="endpoints that need another role", examples=[["POST /v1/runs"]])
    data_dir: str = Field(
        description="the server's data folder, for an operator on its machine; empty for others and for the default one",
        examples=["/srv/valerie"],
    )


class QuotaRead(Read):
    """A quota of an owner or a project, with what counts for it."""

    holder: str = Field(description="an owner, or `project NAME`", examples=["Ada Lovelace"])
    resource: Resource = Field(examples=["cpu-hours"])
    used: float = Field(
        description="unfinished runs, their variants, CPU hours of 30 days, gigabytes stored", examples=[61.5]
    )
    forecast: float = Field(description="CPU hours or gigabytes ahead of unfinished runs", examples=[20.25])
    limit: float = Field(examples=[100.0])


class TokenRead(Read):
    """A token without its secret."""

    name: str = Field(examples=["nightly"])
    owner: str = Field(examples=["Ada Lovelace"])
    role: Role = Field(examples=["runner"])
    project: str = Field(description="the only one that exists for it; empty: all do", examples=["radar"])
    scopes: list[str] = Field(description="areas that it reaches; empty: all", examples=[["metrics"]])
    created_at: Moment = Field(examples=["2026-11-21T02:43:08Z"])
    expires_at: Moment = Field(examples=["2027-02-19T02:43:08Z"])
    revoked_at: Moment | None
    used_at: Moment | None = Field(description="last request, to the minute")


class TokenIssued(TokenRead):
    """A new token with its secret, which cannot be read again."""

    secret: str = Field(description="bearer token; shown only here", examples=["valerie_3q2-7wAA"])


class SignInOffer(Read):
    """The operator's OpenID provider; null without one."""

    page: str | None = Field(description="its authorization endpoint", examples=["https://id.example/authorize"])
    client: str | None = Field(description="its name for this server", examples=["valerie"])


class SignInRequest(Document):
    """A provider's ID token, or the code that it sent to a browser, with what the browser kept meanwhile."""

    id_token: Annotated[str, Field(max_length=20_000)] = ""
    code: Annotated[str, Field(max_length=4_000)] = ""
    verifier: Annotated[str, Field(max_length=128)] = ""
    nonce: Annotated[str, Field(max_length=128)] = ""
    redirect_uri: Annotated[str, Field(max_length=2_000)] = ""

    @model_validator(mode="after")
    def _proof(self) -> Self:
        of_code = [name for name in ("code", "verifier", "nonce", "redirect_uri") if getattr(self, name)]
        if len(of_code) != (0 if self.id_token else 4):
            raise InvalidInput(
                "not a proof of identity", limit="id_token alone; or code, verifier, nonce, redirect_uri"
            )
        return self


class AuditRead(Read):
    """A row of the audit log: before a change (without a status), or its outcome."""

    number: int = Field(description="counts up; rows are never changed or deleted", examples=[17])
    request: str = Field(description="the same before and after", examples=["5f0c3a9be1d24c77"])
    at: Moment = Field(examples=["2026-11-21T02:43:08Z"])
    caller: str | None = Field(
        description="name of the token, or COMMAND; null without a valid one", examples=["nightly"]
    )
    owner: str | None = Field(examples=["Ada Lovelace"])
    role: Role | None = Field(examples=["runner"])
    address: str = Field(examples=["127.0.0.1"])
    method: str = Field(examples=["DELETE"])
    path: str = Field(examples=["/v1/runs/0abc"])
    status: int | None = Field(description="of the answer; the exit code of a command", examples=[204])
    left_out: int = Field(description="refusals before this one that were too many to be kept", examples=[0])
