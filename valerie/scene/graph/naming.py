"""Names in the scene graph: ``ObjectClass-ObjectInstanceID`` states class and instance (paper, section 5.1).

On the way from the root, the first node whose name states a class is *the object*. Everything below it inherits its label and
instance, even a part whose own name states a class: ``car-3.door-1`` belongs to the car, and a bag to the person who carries it.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from typing import NamedTuple

from valerie.errors import InvalidInput
from valerie.labels import BY_ID, CITYSCAPES, MAX_INSTANCE, instance_id, label_of_node_class

#: Root of every path of the scene graph.
ROOT = "scene"
#: Paths of the sun and the environment, which are not nodes.
SUN_PATH = "scene.sun-1"
ENVIRONMENT_PATH = "scene.environment-1"

_CLASSES = {label.node_class: label for label in CITYSCAPES}
_OBJECT_NAME = re.compile(r"([A-Za-z][A-Za-z0-9_-]*)-([0-9]{1,4})")
_NODE_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*(?:-[A-Za-z0-9_]+)*")
_NOT_IN_NAMES = re.compile(r"[^A-Za-z0-9_-]+")
#: Other ways to write a class and a number: ``Person_01``, ``person.1``, ``CAR 2``.
_LIKE_AN_OBJECT = re.compile(r"(?P<name>.*?[^0-9_. -])[_. -]*(?P<number>[0-9]{1,4})?")


def is_cloth(material_name: str) -> bool:
    """Return True for a cloth material: a ``/``-separated part of its name starts with ``cloth-``."""
    return any(part.startswith("cloth-") for part in material_name.split("/"))


class ObjectLabel(NamedTuple):
    """The labels of a node in the ground truth: label id, and instance id (0 for classes without instances)."""

    label_id: int
    instance_id: int


UNLABELLED = ObjectLabel(0, 0)


def parse_object_name(name: str) -> tuple[str, int] | None:
    """Split ``traffic-light-3`` into ``("traffic-light", 3)``; return None for a name without an instance number.

    The class is not checked: see `object_label`.
    """
    match = _OBJECT_NAME.fullmatch(name)
    return (match[1], int(match[2])) if match else None


def object_label(name: str) -> ObjectLabel | None:
    """Return the label and instance that a node's own name states; None if it states no known class.

    Raises:
        InvalidInput: the instance number is above 999.
    """
    parts = parse_object_name(name)
    if parts is None or parts[0] not in _CLASSES:
        return None
    label = _CLASSES[parts[0]]
    if parts[1] > MAX_INSTANCE:
        raise InvalidInput("instance number too large", field=name, value=parts[1], limit=MAX_INSTANCE)
    return ObjectLabel(label.id, instance_id(label, parts[1]))


def class_of_name(name: str) -> str | None:
    """Return the known class that a node's own name states: ``person`` for ``person-1``; None for ``house-1`` or ``Cube``."""
    parts = parse_object_name(name)
    return parts[0] if parts is not None and parts[0] in _CLASSES else None


def likely_name(name: str) -> str | None:
    """Return the name that a node was probably meant to have, e.g. ``person-1`` for ``Person_01``; None if none is similar."""
    match = _LIKE_AN_OBJECT.fullmatch(name)
    if match is None:
        return None
    words = re.sub(r"[_. ]+", "-", re.sub(r"(?<=[a-z])(?=[A-Z])", "-", match["name"])).lower()
    close = get_close_matches(words, _CLASSES, n=1, cutoff=0.75)
    return f"{close[0]}-{int(match['number'] or 1)}" if close else None


def object_labels(paths: Iterable[str], node_classes: Mapping[str, str]) -> dict[str, ObjectLabel]:
    """Return the label and instance of every path.

    Args:
        paths: parents before children.
        node_classes: class by path, for nodes whose names do not state one. It takes precedence over names and is inherited
            (``static`` is the class of objects that are not evaluated). The instance is the number at the end of the name, else
            the lowest free one.

    Raises:
        UnknownName: there is no such class.
        InvalidInput: two objects have the same instance id, or a number is above 999.
    """
    labels: dict[str, ObjectLabel] = {}
    roots: dict[int, str] = {}
    pending: list[tuple[str, str]] = []
    for path in paths:
        parent, _, name = path.rpartition(".")
        if path in node_classes:
            label = label_of_node_class(node_classes[path], field=f"node_classes.{path}")
            parts = parse_object_name(name)
            own = ObjectLabel(label.id, instance_id(label, parts[1]) if parts else 0)
            if label.has_instances and parts is None:
                pending.append((path, label.node_class))
        elif labels.get(parent, UNLABELLED).label_id:
            labels[path] = labels[parent]
            continue
        else:
            own = object_label(name) or UNLABELLED
        labels[path] = own
        _claim(roots, own, path)
    for path, node_class in pending:
        label = _CLASSES[node_class]
        number = next(n for n in range(1, MAX_INSTANCE + 2) if instance_id(label, n) not in roots)
        own = ObjectLabel(label.id, instance_id(label, number))
        _claim(roots, own, path)
        for below in [p for p in labels if (p == path or p.startswith(path + ".")) and labels[p].instance_id == 0]:
            labels[below] = own
    return labels


def _claim(roots: dict[int, str], own: ObjectLabel, path: str) -> None:
    if not own.instance_id:
        return
    other = roots.setdefault(own.instance_id, path)
    if other != path:
        name = BY_ID[own.label_id].name
        raise InvalidInput(
            f"{other} and {path} are the same {name} (instance id {own.instance_id}); number them differently",
            field=path,
        )


def is_node_name(name: str) -> bool:
    """Return True if a name is valid in a path: letters, digits, _ and single -, starting with a letter."""
    return _NODE_NAME.fullmatch(name) is not None


def node_name(original: str | None, index: int) -> str:
    """Return a name that is valid in a path: ``Cube.001`` becomes ``Cube_001``, and None becomes ``node_7``.

    Args:
        original: the name in the file.
        index: the node's index in the file.
    """
    name = re.sub(r"-{2,}", "-", _NOT_IN_NAMES.sub("_", original or "")).strip("-")
    if not name:
        return f"node_{index}"
    return name if is_node_name(name) else f"node_{name}"
