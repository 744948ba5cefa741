"""Checks of names: persons under test, classes of nodes, and likely corrections."""

from __future__ import annotations

from collections.abc import Iterator
from difflib import get_close_matches
from typing import Final

from valerie.labels import CITYSCAPES, PERSON
from valerie.scene.assets.manifest import Manifest
from valerie.scene.assets.objects import alike, missing_nodes, unclassified
from valerie.scene.checks.doubts import Doubt, Severity
from valerie.scene.checks.shapes import HEIGHTS_M, object_boxes
from valerie.scene.graph.model import Scene
from valerie.scene.graph.naming import class_of_name, likely_name, parse_object_name

#: Candidates for a missing node that a finding lists.
_LISTED: Final = 3


def name_findings(scene: Scene, manifest: Manifest) -> Iterator[Doubt]:
    """Yield findings on missing nodes, nodes without class, scenes without persons, and persons that do not move."""
    yield from _missing(scene, manifest)
    people = [path for path, node in scene.nodes.items() if node.label_id == PERSON.id and node.meshes]
    named_above = bool(manifest.persons) and not any(path in scene.nodes for path in manifest.persons)
    if not people and not named_above:
        yield Doubt(
            Severity.ERROR,
            "no-person",
            "",
            "no person: no node named person-1, or with that class by node_classes or placed_files, has a mesh",
        )
    elif people and not manifest.persons:
        yield Doubt(Severity.ERROR, "no-person", "persons", "the manifest names no persons: nobody is under test")
    for path in manifest.persons:
        node = scene.nodes.get(path)
        if node is not None and node.label_id != PERSON.id:
            yield Doubt(
                Severity.ERROR,
                "no-person",
                path,
                "listed under persons, but it is not a person",
                _class_of(node.label_id),
                "person",
            )
        if node is not None and not node.movable and any(p.path.startswith(f"{path}.") for p in manifest.parameters):
            yield Doubt(
                Severity.WARNING,
                "not-movable",
                path,
                "its parameters vary, but it is not under movable: every place needs its own background",
            )
    for path in dict.fromkeys(_to_rename(path) for path in unclassified(scene)):
        name = path.rpartition(".")[2]
        parts = parse_object_name(name)
        likely = likely_name(name)
        hint = f"; call it {likely}?" if likely else ""
        if parts is not None:
            message = f"{parts[0]!r} is not a known class{hint or '; list it in node_classes'}"
        else:
            message = f"it is drawn and has no class: name it ObjectClass-ID or list it in node_classes{hint}"
        yield Doubt(Severity.ERROR, "no-class", path, message, name, "e.g. building-3")


def _to_rename(path: str) -> str:
    """Return the path to rename for a node without class: the nearest ancestor named like an object, else its own path."""
    above = path
    while above.count("."):
        if likely_name(above.rpartition(".")[2]):
            return above
        above = above.rpartition(".")[0]
    return path


def _missing(scene: Scene, manifest: Manifest) -> Iterator[Doubt]:
    """Yield a finding for each node that the manifest names and the scene lacks, with likely candidates."""
    gaps = missing_nodes(scene, manifest)
    names = {*manifest.persons, *manifest.movable, *manifest.grounded}
    upright = _of_a_persons_size(scene) if gaps.keys() & {*manifest.persons} else {}
    for path, fields in gaps.items():
        name = path.rpartition(".")[2]
        kind = class_of_name(name)
        noun = "person" if path in manifest.persons else kind or "node"
        candidates = [other for other in alike(path, scene) if other not in names]
        if kind is None:
            candidates = get_close_matches(path, candidates, n=_LISTED)
        hints = [
            f"{other} is a {kind}: name that in the manifest, or call it {name}"
            if kind is not None and scene.nodes[other].label_id
            else f"{other} looks like it: call it {name}"
            for other in candidates[:_LISTED]
        ]
        if noun == "person":
            hints += [
                f"{other} has no class and the height of a person ({height:.2f} m): call it {name} if it is one"
                for other, height in upright.items()
                if other not in candidates
            ][:_LISTED]
        advice = "; ".join(hints) or f"nothing looks like it: call its node {name}, or take it out of the manifest"
        # Persons are grounded by default.
        places = ", ".join(field for field in fields if field != "grounded" or "persons" not in fields)
        yield Doubt(
            Severity.ERROR,
            "no-person" if noun == "person" else "declared",
            path,
            f"no such {noun} in the files, and the manifest names it under {places}; {advice}",
        )


def _of_a_persons_size(scene: Scene) -> dict[str, float]:
    """Return the heights in metres of upright nodes of a person's height that have no class and no similar name."""
    low, high = HEIGHTS_M["person"]
    heights: dict[str, float] = {}
    for path, box in object_boxes(scene, labelled=False).items():
        width, depth, height = (float(side) for side in box[1] - box[0])
        likely = class_of_name(likely_name(path.rpartition(".")[2]) or "")
        if low <= height <= high and height > max(width, depth) and likely in (None, "person"):
            heights[path] = height
    return heights


def _class_of(label_id: int) -> str:
    return next(label.node_class for label in CITYSCAPES if label.id == label_id)
