"""Label nodes, and check that a scene has everything that its manifest names."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

from valerie.errors import InvalidInput, InvalidInputs, UnknownName
from valerie.labels import label_of_node_class
from valerie.scene.assets.attributes import Target, resolve
from valerie.scene.assets.manifest import Manifest
from valerie.scene.graph.draft import cloth_materials, paint_materials
from valerie.scene.graph.model import Node, Scene
from valerie.scene.graph.naming import ROOT, class_of_name, likely_name, object_labels


def classified(nodes: Iterable[Node], node_classes: Mapping[str, str], movable: Sequence[str]) -> dict[str, Node]:
    """Return nodes with label, instance, movability and effective visibility, all inherited from the nodes above.

    Args:
        nodes: parents before children; every parent is among them or is ``scene``.
        node_classes: class by path, for nodes whose names do not state one.
        movable: paths that move, with everything below them.

    Returns:
        The nodes by path, in the same order.

    Raises:
        InvalidInput: two nodes have one path, a node has no parent, or two objects have one instance id.
        UnknownName: ``node_classes`` or ``movable`` names a missing node, or a class that does not exist.
    """
    ordered = list(nodes)
    by_path: dict[str, Node] = {}
    for node in ordered:
        if node.path in by_path:
            raise InvalidInput("two nodes have the same path", field=node.path)
        if node.parent != ROOT and node.parent not in by_path:
            raise InvalidInput("the node's parent is missing or comes later", field=node.path)
        by_path[node.path] = node
    for path in (*node_classes, *movable):
        if path not in by_path:
            raise UnknownName("node", path, by_path)
    labels = object_labels(by_path, node_classes)
    moving = set(movable)
    for path, node in by_path.items():
        parent = by_path.get(node.parent)
        by_path[path] = replace(
            node,
            label_id=labels[path].label_id,
            instance_id=labels[path].instance_id,
            movable=path in moving or (parent is not None and parent.movable),
            visible=node.visible and (parent is None or parent.visible),
        )
    return by_path


def require_declared(scene: Scene, manifest: Manifest) -> None:
    """Check that everything that a manifest names is in the scene, and that everything drawn has a class.

    Raises:
        UnknownName: a node or camera is missing.
        InvalidInput: neither name nor manifest states the class of a drawn node; or as `declared_problems`.
        InvalidInputs: several of these.
    """
    problems: list[InvalidInput] = [
        UnknownName(class_of_name(_last(path)) or "node", path, alike(path, scene), field=fields[0])
        for path, fields in missing_nodes(scene, manifest).items()
    ]
    problems += declared_problems(scene, manifest)
    nameless = unclassified(scene)
    if nameless:
        problems.append(
            InvalidInput(
                f"{len(nameless)} drawn nodes have no class, first {nameless[0]}: "
                "name them ObjectClass-ID (e.g. building-3) or list them in node_classes",
                field="node_classes",
                value=", ".join(nameless[:5]),
            )
        )
    if problems:
        raise problems[0] if len(problems) == 1 else InvalidInputs(problems)


def missing_nodes(scene: Scene, manifest: Manifest) -> dict[str, tuple[str, ...]]:
    """Return the paths of nodes that the manifest names and the scene lacks, each with the fields that name it.

    Nodes below a missing node are not listed: they are missing for the same reason.
    """
    attributes = (resolve(parameter.path, manifest.cameras) for parameter in manifest.parameters)
    fields: dict[str, Iterable[str]] = {
        "persons": manifest.persons,
        "movable": manifest.movable,
        "grounded": manifest.grounded,
        "node_classes": manifest.node_classes,
        "parameters": [path for path, attribute in attributes if attribute.target is Target.NODE],
    }
    gaps: dict[str, list[str]] = {}
    for field, paths in fields.items():
        for path in dict.fromkeys(paths):
            if path not in scene.nodes:
                gaps.setdefault(path, []).append(field)
    return {
        path: tuple(fields) for path, fields in gaps.items() if not any(path.startswith(f"{other}.") for other in gaps)
    }


def alike(path: str, scene: Scene) -> list[str]:
    """Return candidates for a missing node: nodes of its class or with a similar name, else nodes without class."""
    kind = class_of_name(_last(path))
    if kind is None:
        return [other for other in scene.nodes if class_of_name(_last(other)) is None]
    label = label_of_node_class(kind)
    nameless = {other: likely_name(_last(other)) for other, node in scene.nodes.items() if not node.label_id}
    return [
        other
        for other, node in scene.nodes.items()
        if (node.label_id == label.id and not _inherits(node, scene))
        or class_of_name(nameless.get(other) or "") == kind
    ]


def declared_problems(scene: Scene, manifest: Manifest) -> list[InvalidInput]:
    """Return errors for missing cameras, and for materials that a parameter changes but other nodes share."""
    cameras: list[InvalidInput] = [
        UnknownName("camera", camera, scene.cameras, field="cameras")
        for camera in manifest.cameras
        if camera not in scene.cameras
    ]
    return [*cameras, *_shared_materials(scene, manifest)]


def _shared_materials(scene: Scene, manifest: Manifest) -> Iterator[InvalidInput]:
    """Yield errors for materials that a cloth or colour parameter changes and that other nodes, even the background, share."""
    clothed = {path.partition(".cloth.")[0] for path in manifest.by_path if ".cloth." in path}
    painted = {path.removesuffix(".colour") for path in manifest.by_path if path.endswith(".colour")}
    for owner in sorted((clothed | painted) & scene.nodes.keys()):
        own: set[str] = set()
        if owner in clothed:
            own |= set(cloth_materials(scene, owner))
            if not own:
                yield InvalidInput("no material below it has a name that starts with cloth-", field=owner)
        if owner in painted:
            coats = paint_materials(scene, owner)
            if not coats:
                yield InvalidInput("no material below it has a name that starts with paint-", field=owner)
            own |= set(coats)
        for path, node in scene.nodes.items():
            shared = own.intersection(mesh.material for mesh in node.meshes)
            if shared and path != owner and not path.startswith(f"{owner}."):
                yield InvalidInput(
                    f"{path} shares a material with {owner}, whose clothes or paint vary; give it a separate one",
                    field=owner,
                    value=min(shared),
                )
                break


def unclassified(scene: Scene) -> list[str]:
    """Return the paths of nodes with meshes but without a class."""
    return [path for path, node in scene.nodes.items() if node.meshes and node.label_id == 0]


def _inherits(node: Node, scene: Scene) -> bool:
    """Return True if a node inherits its class from its parent."""
    parent = scene.nodes.get(node.parent)
    return parent is not None and bool(parent.label_id)


def _last(path: str) -> str:
    return path.rpartition(".")[2]
