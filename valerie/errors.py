"""All errors of VALERIE: each states the problem, its data, and a remedy.

They do not depend on HTTP, SQL or Celery. The API maps them to problem documents, the CLI to exit codes, the workers to
retries. Messages about input name the field, the value and the limit, so that users need no stack trace.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from difflib import get_close_matches

#: Largest number of known names that an error lists if none is similar.
_LISTED = 12
#: Largest number of problems in one message.
_PROBLEMS = 50


class ValerieError(Exception):
    """Base class of all errors that VALERIE raises on purpose. The text can be shown to users unchanged."""


class InvalidInput(ValerieError):
    """An input of the user is invalid.

    Args:
        message: the problem, in one sentence.
        field: dotted place in the document, e.g. ``blocks.0.vary.1.step``; empty for the whole input.
        value: the invalid value as the user wrote it, if it can be shown.
        limit: the accepted bound or form.
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
    """Several inputs of the user are invalid; ``problems`` has an error for each."""

    def __init__(self, problems: Sequence[InvalidInput]) -> None:
        self.problems = tuple(problems)
        lines = [str(problem) for problem in self.problems[:_PROBLEMS]]
        further = len(self.problems) - len(lines)
        super().__init__("\n".join([*lines, f"and {further:,} more problems"] if further else lines))
        self.field = self.problems[0].field if self.problems else ""


class UnknownName(InvalidInput):
    """A name is unknown. The message lists similar names.

    Args:
        kind: kind of the name, e.g. ``parameter``, ``renderer``.
        name: the unknown name.
        known: all names of that kind.
        field: dotted place of the name.
        limit: another accepted input.
    """

    def __init__(self, kind: str, name: str, known: Iterable[str], *, field: str = "", limit: object = None) -> None:
        self.kind, self.name, self.known = kind, name, tuple(sorted(known))
        whole = [path for path in self.known if path.endswith(f".{name}")]  # a parameter without its object
        close = [path for path in whole if path.partition(".")[2] not in whole][:3]
        near = get_close_matches(name, self.known, n=6, cutoff=0.55)
        close = close or [path for path in near if not any(path.endswith(f".{other}") for other in near)][:3]
        more = f" and {len(self.known) - _LISTED} more" if len(self.known) > _LISTED else ""
        hint = f"did you mean {', '.join(close)}?" if close else f"known: {', '.join(self.known[:_LISTED]) or 'none'}"
        super().__init__(
            f"unknown {kind} {_short(repr(name))}; {hint}{'' if close else more}", field=field, limit=limit
        )


class NotFound(ValerieError):
    """A stored object does not exist, or no longer exists."""

    def __init__(self, kind: str, key: object) -> None:
        self.kind, self.key = kind, key
        super().__init__(f"there is no {kind} {key}")


class Conflict(ValerieError):
    """The state of an existing object does not allow the request."""


class QuotaExceeded(Conflict):
    """The owner of a token has too much unfinished; the request can succeed later."""


class MissingDependency(ValerieError):
    """A library or program is not installed. The message tells how to install it."""


class TransientError(ValerieError):
    """A failure that may not occur again, such as a lost connection or a crashed driver."""


class StorageFull(TransientError):
    """The artifact store or the database has no space left. A run then pauses instead of failing."""


class StorageUnavailable(TransientError):
    """The artifact store cannot be reached or written."""


class CorruptArtifact(ValerieError):
    """The content of a stored object does not match its key."""


class MissingInput(ValerieError):
    """The stored object of a finished input is missing or damaged, so the input must be computed again."""

    def __init__(self, kind: str, digest: str) -> None:
        self.kind, self.digest = kind, digest
        super().__init__(f"the object of {kind} {digest} is missing or damaged")


class RenderingError(ValerieError):
    """An engine produced no usable image (black, constant, wrong shape) or failed for good."""


class NoAnswer(ValerieError):
    """An address outside of this deployment gave no usable answer."""


class InferenceError(ValerieError):
    """A perception function failed on a picture for good."""


def _short(value: object) -> str:
    text = value if isinstance(value, str) else repr(value)
    return text if len(text) <= 120 else text[:119] + "…"
