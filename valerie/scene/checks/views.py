"""Checks of cameras that are inside something solid, and of persons under test that no camera sees."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from valerie.parameters.definitions import ParameterType
from valerie.scene.assets.asset import SceneAsset
from valerie.scene.checks.doubts import Doubt, Severity
from valerie.scene.checks.shapes import object_boxes, object_of, world_points
from valerie.scene.graph.model import Camera, Scene
from valerie.scene.legality.ground import ground_height

#: Least `enclosure` of a place that counts as inside a surface.
_INSIDE: Final = 0.6
#: Aspect ratio of the picture in which persons must be: that of the default resolution.
_ASPECT: Final = 16 / 9
#: Number of places to try per coordinate of a person.
_STEPS: Final = 15


def view_findings(scene: Scene, asset: SceneAsset) -> Iterator[Doubt]:
    """Yield findings on every camera of the manifest and every person under test.

    Args:
        scene: the asset's scene with every parameter at its default.
        asset: declares the ranges of the places.
    """
    cameras = [scene.cameras[name] for name in asset.manifest.cameras if name in scene.cameras]
    boxes = object_boxes(scene)
    for camera in cameras:
        x, y, z = (float(v) for v in camera.position)
        ground = ground_height(asset.manifest, x, y)
        if z < ground:
            yield Doubt(
                Severity.WARNING, "inside-solid", camera.path, "below the ground", f"z = {z:.3g} m", f"{ground:g} m"
            )
        for owner in _around(scene, boxes, camera.position):
            yield Doubt(
                Severity.WARNING,
                "inside-solid",
                camera.path,
                f"inside {owner}: it sees the back of its surfaces, or through them",
                f"({x:.3g}, {y:.3g}, {z:.3g}) m",
            )
    for path in asset.manifest.persons:
        box = boxes.get(path)
        if box is None or not cameras:
            continue
        if any(in_view(camera, box) for camera in cameras):
            continue
        origin = scene.world_transform(path)[:3, 3]
        share = _share_in_view(asset, path, box, origin, cameras)
        if share == 0.0:
            yield Doubt(
                Severity.WARNING,
                "out-of-view",
                path,
                "no camera sees it anywhere in its range: its pacc would always be undefined (outside the image)",
            )
        else:
            elsewhere = "" if share is None else f"; {share:.0%} of its range is in view"
            yield Doubt(
                Severity.WARNING,
                "out-of-view",
                path,
                "no camera sees it at its default place: its pacc is undefined there (outside the image)" + elsewhere,
                "({:.3g}, {:.3g}) m".format(*origin[:2]),
            )


def in_view(camera: Camera, box: NDArray[np.float64]) -> bool:
    """Return True if a box (2, 3) in the world may reach into a camera's picture of 16 : 9. Errs only towards True."""
    corners = np.array([[box[i, 0], box[j, 1], box[k, 2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    local = (corners - camera.position) @ camera.transform[:3, :3]
    half_width = 0.5 * camera.sensor_width_mm / camera.focal_length_mm
    half_height = half_width / _ASPECT
    depth = -local[:, 2]
    # A convex box is out of the pyramid if all its corners are beyond one of its sides.
    beyond = (
        depth < camera.near,
        local[:, 0] > half_width * depth,
        -local[:, 0] > half_width * depth,
        local[:, 1] > half_height * depth,
        -local[:, 1] > half_height * depth,
    )
    return not any(side.all() for side in beyond)


def enclosure(point: NDArray[np.float64], triangles: NDArray[np.float64]) -> float:
    """Return how far a surface encloses a point: 1 inside a closed surface, 0 outside, between them if it has holes.

    It is the sum of the triangles' solid angles (Van Oosterom and Strackee 1983, doi:10.1109/TBME.1983.325207), as a share of
    all directions (the generalised winding number of Jacobson et al. 2013, doi:10.1145/2461912.2461916).

    Args:
        point: (3,).
        triangles: (F, 3, 3) corners, counter-clockwise seen from outside.
    """
    a, b, c = (triangles[:, i] - point for i in range(3))
    la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c))
    below = (
        la * lb * lc
        + np.einsum("ij,ij->i", a, b) * lc
        + np.einsum("ij,ij->i", b, c) * la
        + np.einsum("ij,ij->i", c, a) * lb
    )
    return float(np.arctan2(volume, below).sum() / (2.0 * math.pi))


def _around(scene: Scene, boxes: Mapping[str, NDArray[np.float64]], point: NDArray[np.float64]) -> Iterator[str]:
    """Yield the objects that enclose a point."""
    near = {owner for owner, box in boxes.items() if (box[0] <= point).all() and (point <= box[1]).all()}
    total = dict.fromkeys(sorted(near), 0.0)
    for path, node in scene.nodes.items() if near else ():
        if not node.visible or not node.label_id or object_of(scene, node) not in near:
            continue
        world = scene.world_transform(path)
        for mesh in node.meshes:
            total[object_of(scene, node)] += enclosure(point, world_points(mesh, world)[mesh.faces.astype(np.int64)])
    yield from (owner for owner, share in total.items() if share >= _INSIDE)


def _share_in_view(
    asset: SceneAsset,
    path: str,
    box: NDArray[np.float64],
    origin: NDArray[np.float64],
    cameras: list[Camera],
) -> float | None:
    """Return the share of a person's declared places at which a camera sees it; None if its place does not vary."""
    by_path = asset.manifest.by_path
    axes = []
    for axis in "xy":
        definition = by_path.get(f"{path}.pos.{axis}")
        if definition is None or definition.type is not ParameterType.FLOAT:
            return None
        if definition.minimum is None or definition.maximum is None:
            return None
        axes.append(np.linspace(float(definition.minimum), float(definition.maximum), _STEPS))
    visible = [
        any(in_view(camera, box + np.array([x - origin[0], y - origin[1], 0.0])) for camera in cameras)
        for x in axes[0]
        for y in axes[1]
    ]
    return sum(visible) / len(visible)
