"""Parameter paths: ``scene.person-1.pos.x`` (paper, section 5.1: ``rootobject_name.{subcomponent_name}.attribute``).

A path starts at the root ``scene`` or ``sensor``, names a node (``scene.person-1``, ``scene.car-3.door-1``) and ends in
an attribute of one or two words (``heading``, ``pos.x``, ``cloth.metallic``).
"""

from __future__ import annotations

import re
from typing import Final

from valerie.errors import InvalidInput

ROOTS: Final = ("scene", "sensor")
MAX_PATH_LENGTH: Final = 200

_PART = re.compile(r"[A-Za-z][A-Za-z0-9_]*(?:-[A-Za-z0-9_]+)*")


def parse_path(path: str, *, field: str = "") -> tuple[str, ...]:
    """Return the parts of a well-formed path, e.g. ``("scene", "person-1", "pos", "x")``.

    Raises:
        InvalidInput: the path has another root, an empty or malformed part, no attribute, or more than `MAX_PATH_LENGTH`
            characters.
    """
    if len(path) > MAX_PATH_LENGTH:
        raise InvalidInput("the path is too long", field=field, value=path, limit=f"{MAX_PATH_LENGTH} characters")
    parts = tuple(path.split("."))
    if parts[0] not in ROOTS:
        raise InvalidInput("a path must start with scene. or sensor.", field=field, value=path)
    if len(parts) < 2:
        raise InvalidInput(
            "a path needs a node and an attribute, such as scene.person-1.pos.x", field=field, value=path
        )
    for part in parts:
        if not _PART.fullmatch(part):
            raise InvalidInput(
                f"{part!r} cannot be part of a path (letters, digits, _ and -, starting with a letter)",
                field=field,
                value=path,
            )
    return parts


def short_name(path: str) -> str:
    """Return the default name of a parameter: its path without ``scene.``."""
    return path.removeprefix("scene.")
