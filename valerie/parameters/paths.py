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
_INSTANCE = re.compile(r".*-[0-9]+")
#: First words of two-word attributes, for nodes whose name has no instance number.
_GROUPS: Final = frozenset({"pos", "rot", "scale", "cloth", "material"})


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


def _split(path: str) -> int:
    parts = parse_path(path)
    if parts[0] == "sensor":
        return 1
    instances = [i for i, part in enumerate(parts[:-1]) if i > 0 and _INSTANCE.fullmatch(part)]
    if instances:
        return instances[-1] + 1
    grouped = len(parts) > 2 and parts[-2] in _GROUPS
    return len(parts) - (2 if grouped else 1)


def node_of(path: str) -> str:
    """Return the node of a path, e.g. ``scene.car-3.door-1`` for ``scene.car-3.door-1.rot.z``."""
    return ".".join(path.split(".")[: _split(path)])


def attribute_of(path: str) -> str:
    """Return the attribute of a path, e.g. ``rot.z`` for ``scene.car-3.door-1.rot.z``."""
    return ".".join(path.split(".")[_split(path) :])


def short_name(path: str) -> str:
    """Return the default name of a parameter: its path without ``scene.``."""
    return path.removeprefix("scene.")
