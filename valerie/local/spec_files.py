"""Spec files of the user."""

from __future__ import annotations

import sys
from pathlib import Path

from valerie.errors import InvalidInput


def read_spec(path: Path) -> bytes:
    """Return the text of a spec file, or of standard input for ``-``.

    Raises:
        InvalidInput: the file cannot be read or is too large.
    """
    from valerie.loading import MAX_BYTES

    try:
        if str(path) == "-":
            text = sys.stdin.buffer.read(MAX_BYTES + 1)
        else:
            with path.open("rb") as stream:
                text = stream.read(MAX_BYTES + 1)
    except OSError as error:
        raise InvalidInput(f"the spec cannot be read ({error.strerror})", value=str(path)) from error
    if len(text) > MAX_BYTES:
        raise InvalidInput("the spec is too large", value=str(path), limit=f"{MAX_BYTES} bytes")
    return text
