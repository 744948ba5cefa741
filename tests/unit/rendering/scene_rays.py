"""The independent oracle: rays through pixel centres, which Embree traces through plain triangles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter, minimum_filter
from trimesh.ray.ray_pyembree import RayMeshIntersector

from valerie.labels import SKY
from valerie.rendering.base import GroundTruth, View
from valerie.scene.graph.model import Camera, Scene


@dataclass(frozen=True, eq=False)
class Triangles:
    intersector: RayMeshIntersector
    labels: NDArray[np.uint8]
    instances: NDArray[np.uint16]


def triangles_of(scene: Scene, *, only_instance: int | None = None) -> Triangles:
    """Return all visible triangles in the world."""
    corners, labels, instances = [], [], []
    for node in scene.nodes.values():
        path, visible = node.path, True
        while path in scene.nodes:
            visible &= scene.nodes[path].visible
            path = path.rpartition(".")[0]
        if not visible or (only_instance is not None and node.instance_id != only_instance):
            continue
        world = scene.world_transform(node.path)
        for mesh in node.meshes:
            points = mesh.positions.astype(np.float64) @ world[:3, :3].T + world[:3, 3]
            corners.append(points[mesh.faces])
            labels.append(np.full(len(mesh.faces), node.label_id, np.uint8))
            instances.append(np.full(len(mesh.faces), node.instance_id, np.uint16))
    soup = np.concatenate(corners)
    mesh = trimesh.Trimesh(soup.reshape(-1, 3), np.arange(len(soup) * 3).reshape(-1, 3), process=False)
    return Triangles(RayMeshIntersector(mesh), np.concatenate(labels), np.concatenate(instances))


def pixel_rays(camera: Camera, view: View, row: int | None = None) -> NDArray[np.float64]:
    """Return rays through pixel centres, (H, W, 3), of depth 1 along the optical axis, without the engine's code.

    With ``row``, only those of this row, (1, W, 3).
    """
    focal = camera.focal_length_mm / camera.sensor_width_mm * view.width
    first, last = (0, view.height) if row is None else (row, row + 1)
    rows, columns = np.mgrid[first:last, 0 : view.width]
    x, y = (columns + 0.5 - view.width / 2) / focal, -(rows + 0.5 - view.height / 2) / focal
    rays: NDArray[np.float64] = np.stack([x, y, -np.ones_like(x)], axis=2) @ camera.transform[:3, :3].T
    return rays


def trace(
    triangles: Triangles, camera: Camera, view: View, row: int | None = None
) -> tuple[NDArray[np.uint8], NDArray[np.uint16], NDArray[np.float64]]:
    """Trace class map, instance map and depth along the optical axis; with ``row``, of this row alone."""
    rays = pixel_rays(camera, view, row).reshape(-1, 3)
    origins = np.broadcast_to(camera.position, rays.shape)
    hit = triangles.intersector.intersects_first(origins, rays)
    hits = hit >= 0
    classes = np.where(hits, triangles.labels[hit], SKY.id).astype(np.uint8)
    instances = np.where(hits, triangles.instances[hit], 0).astype(np.uint16)
    plane = triangles.intersector.mesh.triangles[hit]
    normal = np.cross(plane[:, 1] - plane[:, 0], plane[:, 2] - plane[:, 0])
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = ((plane[:, 0] - origins) * normal).sum(axis=1) / (rays * normal).sum(axis=1)
    shape = (-1, view.width)
    return classes.reshape(shape), instances.reshape(shape), np.where(hits, depth, np.inf).reshape(shape)


def blocked(triangles: Triangles, points: NDArray[np.float64], direction: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return (N,) bool, True if a ray from the point in a direction hits a surface."""
    hits: NDArray[np.bool_] = triangles.intersector.intersects_any(points, np.broadcast_to(direction, points.shape))
    return hits


def near_edges(labels: NDArray[np.integer]) -> NDArray[np.bool_]:
    """Return the pixels of which one of the eight neighbours has another label."""
    edges: NDArray[np.bool_] = maximum_filter(labels, 3) != minimum_filter(labels, 3)
    return edges


def assert_agrees(
    truth: GroundTruth, classes: NDArray[np.uint8], instances: NDArray[np.uint16], depth: NDArray[np.float64]
) -> None:
    """Fail unless rendered truth agrees with traced rays: labels may differ rarely and only at edges, depths by rounding."""
    for rendered, traced in ((truth.class_map, classes), (truth.instance_map, instances)):
        wrong = rendered != traced
        assert not (wrong & ~near_edges(rendered) & ~near_edges(traced)).any()
        assert wrong.mean() < 0.005
    same = (truth.class_map == classes) & (truth.instance_map == instances)
    hit = np.isfinite(truth.depth)
    np.testing.assert_array_equal(hit[same], np.isfinite(depth)[same])
    # At a crease of an object, a pixel may show another face. All other depths agree to a tenth of a millimetre or 10⁻⁵.
    both = same & hit
    error = np.abs(truth.depth[both] - depth[both]) / np.maximum(depth[both], 10.0)
    assert np.quantile(error, 0.98) < 1e-5
