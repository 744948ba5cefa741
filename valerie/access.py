"""Roles, scopes, projects and secrets of the API's tokens."""

from __future__ import annotations

import hashlib
import secrets
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

#: A project: groups runs, studies and saved selections, which its tokens share and no other project's tokens see.
PROJECT: Final = r"^[a-z0-9][a-z0-9._-]{0,63}$"
#: Begins every secret, so that scanners for leaked secrets find it.
SECRET_PREFIX: Final = "valerie_"  # noqa: S105
_SECRET_BYTES: Final = 32


class Role(StrEnum):
    """Rights of a token; each role includes those before it."""

    VIEWER = "viewer"
    RUNNER = "runner"
    ADMIN = "admin"

    def includes(self, other: Role) -> bool:
        """Return True if this role has all rights of the other."""
        order = list(Role)
        return order.index(self) >= order.index(other)


class Area(StrEnum):
    """A part of the API, by the tag of its endpoints; a token with scopes reaches these areas and no others."""

    ACCESS = "access"
    AUDIT = "audit"
    CATALOG = "catalog"
    DRAFTS = "drafts"
    EXPLORE = "explore"
    FRAMES = "frames"
    FUNCTIONS = "functions"
    MARKS = "marks"
    METRICS = "metrics"
    PREDICTIONS = "predictions"
    RESULTS = "results"
    RUNS = "runs"
    STUDIES = "studies"
    TOKENS = "tokens"


@dataclass(frozen=True, slots=True)
class Caller:
    """Someone who sends a request.

    Attributes:
        name: name of the token; `OPERATOR` for that of the settings, and where no token is needed.
        owner: person or service that holds the token; empty for the operator.
        role: its rights.
        project: the only one that exists for the caller; empty: all do.
        scopes: names of the areas that it reaches; empty: all.
    """

    name: str
    owner: str
    role: Role
    project: str = ""
    scopes: tuple[str, ...] = ()


#: The caller with the token of the settings. No token can have this name, since names have no capitals.
OPERATOR: Final = Caller("OPERATOR", "", Role.ADMIN)

#: In the audit log, the caller of commands that change the database directly.
COMMAND: Final = "COMMAND"


def new_secret() -> str:
    """Return a random secret of 256 bits."""
    return SECRET_PREFIX + secrets.token_urlsafe(_SECRET_BYTES)


def digest_of(secret: str) -> str:
    """Return the SHA-256 of a secret, in hexadecimal.

    Slow hashes with a salt protect passwords, which can be guessed. Nobody guesses 256 random bits, and equal secrets do not
    occur, so that one fast hash is enough and a secret can be looked up by it.
    """
    return hashlib.sha256(secret.encode()).hexdigest()
