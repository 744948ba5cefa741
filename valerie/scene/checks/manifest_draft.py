"""Drafts of manifests for folders of glTF files. Places and outlines are measured; the author corrects the draft."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Final

import numpy as np
import shapely
import yaml
from numpy.typing import NDArray

from valerie.errors import InvalidInput
from valerie.labels import BY_ID, PERSON
from valerie.plain import JsonObject
from valerie.scene.assets.asset_folder import MANIFEST_FILE
from valerie.scene.assets.manifest import parse_manifest
from valerie.scene.checks.shapes import object_boxes, object_of, world_points
from valerie.scene.graph.model import Scene
from valerie.scene.graph.naming import ROOT, likely_name, object_labels
from valerie.spelling import plain_name

#: Classes of objects that nobody can stand in.
_SOLID: Final = frozenset(
    {"building", "wall", "fence", "guard-rail", "car", "truck", "bus", "caravan", "trailer", "train", "motorcycle"}
)
#: Height up to which an object is in a person's way, metres above the ground.
_REACH_M: Final = 2.2
#: Largest share of the extent for a footprint. A larger one belongs to a whole scene, whose convex outline is useless.
_LARGEST_SHARE: Final = 0.25
#: Height of the camera that is added if no file has one, metres.
_EYES_M: Final = 1.6
_HEADER: Final = """\
# Drafted from the files of this folder: correct it, then run `valerie asset check` (docs/assets.md).
"""


def draft_manifest(folder: Path) -> Path:
    """Write a first ``manifest.yaml`` for the glTF files in and below a folder.

    Files whose nodes follow the naming convention are listed. Others are placed, with their own coordinates, below a node named
    after the file.

    Returns:
        The path of the manifest.

    Raises:
        InvalidInput: there is a manifest already, or no file; a file cannot be read; or two files contradict each other.
    """
    path = folder / MANIFEST_FILE
    if path.exists():
        raise InvalidInput("there is a manifest already; it is not overwritten", field=str(path))
    text = yaml.safe_dump(
        manifest_draft(folder), sort_keys=False, allow_unicode=True, default_flow_style=None, width=120
    )
    try:
        path.write_text(_HEADER + text, "utf-8")
    except OSError as error:
        raise InvalidInput(f"the file cannot be written ({error.strerror})", value=str(path)) from None
    return path


def manifest_draft(folder: Path) -> JsonObject:
    """Return the document that `draft_manifest` writes."""
    from valerie.scene.assets.gltf_scene import merge
    from valerie.scene.gltf.reader import read_gltf

    files = sorted(
        file.relative_to(folder).as_posix() for file in folder.rglob("*") if file.suffix.lower() in (".glb", ".gltf")
    )
    if not files:
        raise InvalidInput("no glTF file in or below the folder", field=str(folder), limit=".glb or .gltf")
    parts = {file: read_gltf(folder / file, folder) for file in files}
    own: list[str] = []
    entries: list[JsonObject] = []
    for file, part in parts.items():
        labels = object_labels([node.path for node in part.nodes], {})
        if any(labels[node.path].label_id for node in part.nodes if node.meshes):
            own.append(file)
        else:
            entries.append({"file": file, "node": _free_name(file, entries)})
    name = plain_name(folder.resolve().name.lower(), also="_", longest=64) or "asset"
    document: JsonObject = {"name": name, "title": folder.resolve().name}
    document |= ({"files": own} if own else {}) | ({"placed_files": entries} if entries else {})
    cameras = sorted({camera for file in own for camera in parts[file].cameras})
    stand_ins = {"extent": [-1, -1, 1, 1], "cameras": cameras or ["none"]}
    scene = merge(parts, parse_manifest(document | stand_ins, source=MANIFEST_FILE))
    boxes = object_boxes(scene)
    extent = _extent(boxes)
    document["extent"] = extent
    if cameras:
        document["cameras"] = cameras
    else:
        x, y = (extent[0] + extent[2]) / 2, float(extent[1])
        document["placed_cameras"] = [{"name": "camera-1", "position": [x, y, _EYES_M], "yaw_deg": 0.0}]
    persons = sorted(path for path, node in scene.nodes.items() if node.parent == ROOT and node.label_id == PERSON.id)
    document["persons"], document["movable"] = persons, list(persons)  # one list would be written as a YAML alias
    document["parameters"] = _parameters(scene, persons, extent)
    document["obstacles"] = _obstacles(scene, boxes, extent)
    parse_manifest(document, source=MANIFEST_FILE)
    return document


def _free_name(file: str, entries: list[JsonObject]) -> str:
    likely = likely_name(Path(file).stem)
    names = {entry["node"] for entry in entries}
    stem, number = likely.rsplit("-", 1) if likely else ("static", "1")
    candidate = int(number)
    while f"{stem}-{candidate}" in names:
        candidate += 1
    return f"{stem}-{candidate}"


def _extent(boxes: Mapping[str, NDArray[np.float64]]) -> list[int]:
    if not boxes:
        raise InvalidInput("the files contain no geometry", field=MANIFEST_FILE)
    corners = np.stack(list(boxes.values()))
    low, high = corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)
    x0, y0 = (math.floor(v) for v in low[:2])
    x1, y1 = (math.ceil(v) for v in high[:2])
    return [x0, y0, max(x1, x0 + 1), max(y1, y0 + 1)]


def _parameters(scene: Scene, persons: list[str], extent: list[int]) -> list[JsonObject]:
    parameters: list[JsonObject] = []
    x0, y0, x1, y1 = extent
    for path in persons:
        x, y = (round(float(v), 3) for v in scene.nodes[path].transform[:2, 3])
        parameters += [
            {"path": f"{path}.pos.x", "minimum": x0, "maximum": x1, "default": min(max(x, x0), x1)},
            {"path": f"{path}.pos.y", "minimum": y0, "maximum": y1, "default": min(max(y, y0), y1)},
            {"path": f"{path}.heading", "default": 0.0},
        ]
    sun = scene.sun
    elevation = round(min(max(math.degrees(sun.elevation), 5.0), 85.0), 1)
    return [
        *parameters,
        {"path": "scene.sun-1.azimuth", "default": round(math.degrees(sun.azimuth) % 360.0, 1)},
        {"path": "scene.sun-1.elevation", "minimum": 5.0, "maximum": 85.0, "default": elevation},
    ]


def _obstacles(scene: Scene, boxes: Mapping[str, NDArray[np.float64]], extent: list[int]) -> list[JsonObject]:
    """Return convex outlines of the objects that are in a person's way."""
    points: dict[str, list[NDArray[np.float64]]] = {}
    for path, node in scene.nodes.items():
        if node.visible and node.meshes and BY_ID[node.label_id].node_class in _SOLID:
            world = scene.world_transform(path)
            points.setdefault(object_of(scene, node), []).extend(world_points(mesh, world) for mesh in node.meshes)
    largest = _LARGEST_SHARE * (extent[2] - extent[0]) * (extent[3] - extent[1])
    obstacles: list[JsonObject] = []
    for owner, clouds in points.items():
        together = np.concatenate(clouds)
        low = together[together[:, 2] < _REACH_M]
        if len(low) < 3:
            continue
        outline = shapely.MultiPoint(low[:, :2]).convex_hull.simplify(0.05)
        if not isinstance(outline, shapely.Polygon) or not 0.0 < outline.area <= largest:
            continue
        polygon = [[round(float(v), 2) for v in corner] for corner in outline.exterior.coords[:-1]]
        obstacles.append(
            {"path": owner, "polygon": polygon, "height_m": max(round(float(boxes[owner][1, 2]), 2), 0.01)}
        )
    return obstacles
