"""Names: who is under test, which class everything has, and what a node was probably meant to be called."""

from __future__ import annotations

import re
from collections.abc import Iterator
from difflib import get_close_matches

from valerie.labels import CITYSCAPES, PERSON
from valerie.scene.checks.findings import Finding, Severity
from valerie.scene.manifest import Manifest
from valerie.scene.model import Scene
from valerie.scene.naming import parse_object_name
from valerie.scene.objects import unclassified

_CLASSES = tuple(label.node_class for label in CITYSCAPES)
#: ``Person_01``, ``person.1``, ``CAR 2``: what others write for a class and a number.
_LIKE_AN_OBJECT = re.compile(r"(?P<name>.*?[^0-9_. -])[_. -]*(?P<number>[0-9]{1,4})?")


def name_findings(scene: Scene, manifest: Manifest) -> Iterator[Finding]:
    """Nodes without class, scenes without persons, persons that do not move."""
    people = [path for path, node in scene.nodes.items() if node.label_id == PERSON.id and node.meshes]
    if not people:
        yield Finding(
            Severity.ERROR,
            "no-person",
            "",
            "no person: no node called person-1 (or made one by node_classes or placed_files) has a mesh",
        )
    elif not manifest.persons:
        yield Finding(Severity.ERROR, "no-person", "persons", "the manifest names no persons: nobody is under test")
    for path in manifest.persons:
        node = scene.nodes.get(path)
        if node is not None and node.label_id != PERSON.id:
            yield Finding(
                Severity.ERROR,
                "no-person",
                path,
                "listed under persons, but it is none",
                _class_of(node.label_id),
                "person",
            )
        if node is not None and not node.movable and any(p.path.startswith(f"{path}.") for p in manifest.parameters):
            yield Finding(
                Severity.WARNING,
                "not-movable",
                path,
                "its parameters vary, but it is not under movable: a background is made for every place",
            )
    for path in unclassified(scene):
        name = path.rpartition(".")[2]
        parsed = parse_object_name(name)
        likely = likely_name(name)
        hint = f"; call it {likely}?" if likely else ""
        if parsed is not None:
            message = f"{parsed[0]!r} is no known class{hint or '; list it in node_classes'}"
        else:
            message = f"it is drawn and has no class: name it ObjectClass-ID or list it in node_classes{hint}"
        yield Finding(Severity.ERROR, "no-class", path, message, name, "as building-3")


def likely_name(name: str) -> str | None:
    """What a node was probably meant to be called, e.g. ``person-1`` for ``Person_01``; None if nothing is near."""
    match = _LIKE_AN_OBJECT.fullmatch(name)
    if match is None:
        return None
    words = re.sub(r"[_. ]+", "-", re.sub(r"(?<=[a-z])(?=[A-Z])", "-", match["name"])).lower()
    close = get_close_matches(words, _CLASSES, n=1, cutoff=0.75)
    return f"{close[0]}-{int(match['number'] or 1)}" if close else None


def _class_of(label_id: int) -> str:
    return next(label.node_class for label in CITYSCAPES if label.id == label_id)
