"""From bare nodes to a labelled scene: who is what, what moves, what is shown."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

from valerie.errors import InvalidInput, UnknownName
from valerie.scene.draft import cloth_materials, paint_materials
from valerie.scene.manifest import Manifest
from valerie.scene.model import Node, Scene
from valerie.scene.naming import ROOT, object_labels


def classified(nodes: Iterable[Node], node_classes: Mapping[str, str], movable: Sequence[str]) -> dict[str, Node]:
    """Give nodes their label, instance, movability and effective visibility, all inherited from above.

    Args:
        nodes: parents before children; every parent is among them or is ``scene``.
        node_classes: class by path, where names do not tell.
        movable: paths that move with all below them.

    Returns:
        The nodes by path, in the same order.

    Raises:
        InvalidInput: a path twice, a node without its parent, or two objects with one instance id.
        UnknownName: ``node_classes`` or ``movable`` name a node that is not there, or a class that does not exist.
    """
    given = list(nodes)
    by_path: dict[str, Node] = {}
    for node in given:
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
    """Check that what a manifest speaks of is in the scene, and that everything drawn has a class.

    Raises:
        UnknownName: a person, camera, grounded node or obstacle that is not there.
        InvalidInput: a node is drawn, but its name tells no class and the manifest gives none.
    """
    for field in ("persons", "grounded"):
        for path in getattr(manifest, field):
            if path not in scene.nodes:
                raise UnknownName("node", path, scene.nodes, field=field)
    for camera in manifest.cameras:
        if camera not in scene.cameras:
            raise UnknownName("camera", camera, scene.cameras, field="cameras")
    _require_own_materials(scene, manifest)
    nameless = unclassified(scene)
    if nameless:
        raise InvalidInput(
            f"{len(nameless)} drawn nodes have no class, first {nameless[0]}: "
            "name them ObjectClass-ID (as building-3) or list them in node_classes",
            field="node_classes",
            value=", ".join(nameless[:5]),
        )


def _require_own_materials(scene: Scene, manifest: Manifest) -> None:
    """What cloth and colour parameters change must be that node's alone: else other nodes, even the background, change."""
    clothed = {path.partition(".cloth.")[0] for path in manifest.by_path if ".cloth." in path}
    painted = {path.removesuffix(".colour") for path in manifest.by_path if path.endswith(".colour")}
    for owner in sorted(clothed | painted):
        own: set[str] = set()
        if owner in clothed:
            own |= set(cloth_materials(scene, owner))
            if not own:
                raise InvalidInput("nothing worn below it: no material whose name starts with cloth-", field=owner)
        if owner in painted:
            coats = paint_materials(scene, owner)
            if not coats:
                raise InvalidInput("nothing painted below it: no material whose name starts with paint-", field=owner)
            own |= set(coats)
        for path, node in scene.nodes.items():
            shared = own.intersection(mesh.material for mesh in node.meshes)
            if shared and path != owner and not path.startswith(f"{owner}."):
                raise InvalidInput(
                    f"{path} is drawn with a material that {owner} wears or is painted with, and varies; give it one of its own",
                    field=owner,
                    value=min(shared),
                )


def unclassified(scene: Scene) -> list[str]:
    """Paths of nodes with meshes that no class is known of."""
    return [path for path, node in scene.nodes.items() if node.meshes and node.label_id == 0]
