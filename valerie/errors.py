"""The one tree of errors: what went wrong, with its data, and what to do about it.

An error here knows nothing of HTTP, SQL or Celery. The API maps classes to problem documents, the CLI to exit codes, the
workers to retries. Every message names the field, the value and the limit, so that nobody needs a stack trace.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from difflib import get_close_matches

#: Known names that an error lists where none is near.
_LISTED = 12


class ValerieError(Exception):
    """Base of all errors that VALERIE raises on purpose; its text may be shown to a user as it is."""


class InvalidInput(ValerieError):
    """Something that a user gave is wrong.

    Args:
        message: what is wrong, in one sentence.
        field: dotted place in the document, e.g. ``blocks.0.vary.1.step``; empty when the whole input is meant.
        value: the offending value as it was given, if it can be shown.
        limit: the bound or the form that would have been accepted.
    """

    def __init__(self, message: str, *, field: str = "", value: object = None, limit: object = None) -> None:
        self.message, self.field, self.value, self.limit = message, field, value, limit
        parts = [f"{field}: {message}" if field else message]
        if value is not None:
            parts.append(f"got {_short(value)}")
        if limit is not None:
            parts.append(f"limit: {_short(limit)}")
        super().__init__("; ".join(parts))


class InvalidInputs(InvalidInput):
    """Several things that a user gave are wrong; ``problems`` holds each."""

    def __init__(self, problems: Sequence[InvalidInput]) -> None:
        self.problems = tuple(problems)
        super().__init__("\n".join(str(problem) for problem in self.problems))
        self.field = self.problems[0].field if self.problems else ""


class UnknownName(InvalidInput):
    """A name that nothing declares; the message lists near matches.

    Args:
        kind: what was looked for, e.g. ``parameter``, ``renderer``.
        name: the unknown name.
        known: all names of that kind.
        field: where the name was given.
        limit: what else could have stood there.
    """

    def __init__(self, kind: str, name: str, known: Iterable[str], *, field: str = "", limit: object = None) -> None:
        self.kind, self.name, self.known = kind, name, tuple(sorted(known))
        close = get_close_matches(name, self.known, n=3, cutoff=0.5)
        more = f" and {len(self.known) - _LISTED} more" if len(self.known) > _LISTED else ""
        hint = f"did you mean {', '.join(close)}?" if close else f"known: {', '.join(self.known[:_LISTED]) or 'none'}"
        super().__init__(f"unknown {kind} {name!r}; {hint}{'' if close else more}", field=field, limit=limit)


class NotFound(ValerieError):
    """A stored thing that does not exist (or no longer)."""

    def __init__(self, kind: str, key: object) -> None:
        self.kind, self.key = kind, key
        super().__init__(f"there is no {kind} {key}")


class Conflict(ValerieError):
    """The thing exists, but its state does not allow what was asked."""


class MissingDependency(ValerieError):
    """An optional library or a system library is not installed; the message says how to install it."""


class TransientError(ValerieError):
    """Something that may succeed when tried again: a lost connection, a crashed driver."""


class StorageFull(TransientError):
    """The artifact store or the database has no space left; a run pauses on this instead of failing."""


class StorageUnavailable(TransientError):
    """The artifact store cannot be reached or written."""


class CorruptArtifact(ValerieError):
    """A stored object does not hold what its key promises."""


class MissingInput(ValerieError):
    """The stored object of a finished input is gone or damaged; it has to be made again.

    Args:
        kind: of the input.
        digest: of the input.
    """

    def __init__(self, kind: str, digest: str) -> None:
        self.kind, self.digest = kind, digest
        super().__init__(f"the object of {kind} {digest} is missing or damaged")


class RenderingError(ValerieError):
    """An engine produced no usable image (black, constant, wrong shape) or failed for good."""


class InferenceError(ValerieError):
    """A perception function failed on a picture for good."""


def _short(value: object, limit: int = 120) -> str:
    text = value if isinstance(value, str) else repr(value)
    return text if len(text) <= limit else text[: limit - 1] + "…"
