"""The independent oracle: rays through pixel centres, which Embree traces through triangles and where alpha cuts them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter, minimum_filter
from trimesh.ray.ray_pyembree import RayMeshIntersector

from tests.sampling import enough_to_show
from valerie.labels import SKY
from valerie.rendering.base import GroundTruth, View
from valerie.scene.graph.model import Camera, Scene


@dataclass(frozen=True, eq=False)
class Triangles:
    """Visible triangles.

    Attributes:
        labels, instances: (N,).
        uvs: (N, 3, 2).
        cuts: (N,) index of what cuts a triangle, −1 for nothing.
        cutouts: alpha of a texture, (height, width) in 0…1, and the smallest alpha that is seen.
    """

    intersector: RayMeshIntersector
    labels: NDArray[np.uint8]
    instances: NDArray[np.uint16]
    uvs: NDArray[np.float64]
    cuts: NDArray[np.int64]
    cutouts: tuple[tuple[NDArray[np.float64], float], ...]

    def first_hits(self, origins: NDArray[np.float64], rays: NDArray[np.float64]) -> NDArray[np.int64]:
        """Return the index of the first triangle that each ray, (M, 3), meets where it is not cut out; −1 for none."""
        hits, origins, going = np.full(len(rays), -1), origins.copy(), np.arange(len(rays))
        while len(going):
            hits[going] = self.intersector.intersects_first(origins[going], rays[going])
            going = going[(hits[going] >= 0) & (self.cuts[hits[going]] >= 0)]
            along, seen = self._at(hits[going], origins[going], rays[going])
            going = going[~seen]
            # Behind the card by more than the rounding of a hit, in metres. At grazing angles, the hit may seem to lie behind.
            origins[going] += (np.maximum(along[~seen], 0.0) + 1e-4)[:, None] * rays[going]
        return hits

    def _at(
        self, hit: NDArray[np.int64], origins: NDArray[np.float64], rays: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Return the way to each hit in lengths of its ray, and where alpha leaves the triangle."""
        corners = self.intersector.mesh.triangles[hit]
        edges = np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], -rays], axis=2)
        u, v, along = np.linalg.solve(edges, (origins - corners[:, 0])[..., None])[..., 0].T
        places = np.einsum("nk,nki->ni", np.stack([1.0 - u - v, u, v], axis=1), self.uvs[hit])
        seen = np.zeros(len(hit), np.bool_)
        for number, (alpha, cutoff) in enumerate(self.cutouts):
            here = self.cuts[hit] == number
            seen[here] = blended(alpha, places[here]) >= cutoff
        return along, seen


def blended(alpha: NDArray[np.float64], uvs: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a repeated texture, (height, width), at (N, 2) coordinates, blended from four texels as OpenGL does."""
    height, width = alpha.shape
    x, y = uvs[:, 0] * width - 0.5, uvs[:, 1] * height - 0.5
    column, row = np.floor(x).astype(int), np.floor(y).astype(int)
    right, down = x - column, y - row
    upper, lower = (
        alpha[(row + j) % height, column % width] * (1 - right)
        + alpha[(row + j) % height, (column + 1) % width] * right
        for j in (0, 1)
    )
    mixed: NDArray[np.float64] = upper * (1 - down) + lower * down
    return mixed


def triangles_of(scene: Scene, *, only_instance: int | None = None) -> Triangles:
    """Return all visible triangles in the world."""
    corners, labels, instances, uvs, cuts = [], [], [], [], []
    numbers: dict[tuple[str, float], int] = {}
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
            uvs.append(mesh.uvs.astype(np.float64)[mesh.faces])
            material, number = scene.materials[mesh.material], -1
            if material.alpha_cutoff is not None and material.base_color_texture is not None:
                number = numbers.setdefault((material.base_color_texture, material.alpha_cutoff), len(numbers))
            cuts.append(np.full(len(mesh.faces), number))
    soup = np.concatenate(corners)
    mesh = trimesh.Trimesh(soup.reshape(-1, 3), np.arange(len(soup) * 3).reshape(-1, 3), process=False)
    cutouts = tuple((scene.textures[name].image[..., 3] / 255.0, cutoff) for name, cutoff in numbers)
    intersector = RayMeshIntersector(mesh)
    return Triangles(
        intersector,
        np.concatenate(labels),
        np.concatenate(instances),
        np.concatenate(uvs),
        np.concatenate(cuts),
        cutouts,
    )


def pixel_rays(
    camera: Camera, view: View, row: int | None = None, *, right: float = 0.0, down: float = 0.0
) -> NDArray[np.float64]:
    """Return rays through pixel centres, (H, W, 3), of depth 1 along the optical axis, without the engine's code.

    With ``row``, only those of this row, (1, W, 3). ``right`` and ``down`` move the rays, in pixels.
    """
    focal = camera.focal_length_mm / camera.sensor_width_mm * view.width
    first, last = (0, view.height) if row is None else (row, row + 1)
    rows, columns = np.mgrid[first:last, 0 : view.width]
    x, y = (columns + 0.5 + right - view.width / 2) / focal, -(rows + 0.5 + down - view.height / 2) / focal
    rays: NDArray[np.float64] = np.stack([x, y, -np.ones_like(x)], axis=2) @ camera.transform[:3, :3].T
    return rays


Traced = tuple[NDArray[np.uint8], NDArray[np.uint16], NDArray[np.float64]]


def trace(
    triangles: Triangles,
    camera: Camera,
    view: View,
    row: int | None = None,
    *,
    right: float = 0.0,
    down: float = 0.0,
) -> Traced:
    """Trace class map, instance map and depth along the optical axis, for rays as in `pixel_rays`."""
    rays = pixel_rays(camera, view, row, right=right, down=down).reshape(-1, 3)
    origins = np.broadcast_to(camera.position, rays.shape)
    hit = triangles.first_hits(origins, rays)
    hits = hit >= 0
    classes = np.where(hits, triangles.labels[hit], SKY.id).astype(np.uint8)
    instances = np.where(hits, triangles.instances[hit], 0).astype(np.uint16)
    plane = triangles.intersector.mesh.triangles[hit]
    normal = np.cross(plane[:, 1] - plane[:, 0], plane[:, 2] - plane[:, 0])
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = ((plane[:, 0] - origins) * normal).sum(axis=1) / (rays * normal).sum(axis=1)
    shape = (-1, view.width)
    return classes.reshape(shape), instances.reshape(shape), np.where(hits, depth, np.inf).reshape(shape)


#: Farthest place from a pixel's centre whose light the pixel may hold, in pixels along each axis: the resolve filter takes the
#: mean of a neighbour one pixel away, whose outer samples lie a quarter of a pixel from its centre.
FOOTPRINT = 1.25


@dataclass(frozen=True, eq=False)
class Footprints:
    """The surfaces that pixels show.

    Attributes:
        points: (9, H, W, 3), the surface at the pixel's centre and around it, at the edges of its `FOOTPRINT`.
        normals: (H, W, 3), towards the camera, at the centre.
        flat: (H, W) bool, True if all nine points lie in one plane.
    """

    points: NDArray[np.float64]
    normals: NDArray[np.float64]
    flat: NDArray[np.bool_]


def footprints(triangles: Triangles, camera: Camera, view: View) -> Footprints:
    """Trace nine rays per pixel."""
    points, normals, hits = [], [], []
    for right, down in product((0.0, -FOOTPRINT, FOOTPRINT), repeat=2):
        rays = pixel_rays(camera, view, right=right, down=down).reshape(-1, 3)
        origins = np.broadcast_to(camera.position, rays.shape)
        hit = triangles.first_hits(origins, rays)
        corners = triangles.intersector.mesh.triangles[hit]
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        towards = (rays * normal).sum(axis=1)
        normal *= -np.sign(towards)[:, None] / np.linalg.norm(normal, axis=1, keepdims=True)
        towards = np.where(hit < 0, -1.0, (rays * normal).sum(axis=1))
        points.append(origins + rays * (((corners[:, 0] - origins) * normal).sum(axis=1) / towards)[:, None])
        normals.append(normal)
        hits.append(hit >= 0)
    off = np.array([((place - points[0]) * normals[0]).sum(axis=1) for place in points])
    turned = np.array([(normal * normals[0]).sum(axis=1) for normal in normals])
    flat = np.array(hits).all(axis=0) & (np.abs(off) < 1e-6).all(axis=0) & (turned > 1 - 1e-6).all(axis=0)
    shape = (view.height, view.width)
    return Footprints(np.array(points).reshape(-1, *shape, 3), normals[0].reshape(*shape, 3), flat.reshape(shape))


def dark_and_lit(
    seen: Footprints,
    hides: Callable[[NDArray[np.float64]], NDArray[np.bool_]],
    margin: NDArray[np.float64],
    error: float = 0.03,
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return the pixels, (H, W) each, whose whole footprint is in the shadow, and those where all of it is in the light.

    Args:
        seen: what the pixels show.
        hides: from points, (N, 3), to (N,) bool, True if an object hides the light from the point.
        margin: (H, W), metres along the surface within which a shadow's edge makes a pixel neither.
        error: an error in this share of the pixels must show.
    """
    across = np.cross(seen.normals, np.where(np.abs(seen.normals[..., 2:]) < 0.9, [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]))
    across /= np.maximum(np.linalg.norm(across, axis=2, keepdims=True), 1e-12)
    along = np.cross(seen.normals, across)
    steps = [np.zeros_like(across)]
    steps += [margin[..., None] * (np.cos(turn) * across + np.sin(turn) * along) for turn in np.arange(8) * np.pi / 4]
    places = (seen.points[:, None] + np.array(steps))[:, :, seen.flat]
    hidden = np.array([hides(row) for row in places.reshape(-1, *places.shape[2:])])
    dark, lit = np.zeros((2, *seen.flat.shape), np.bool_)
    dark[seen.flat], lit[seen.flat] = hidden.all(axis=0), ~hidden.any(axis=0)
    assert min(dark.sum(), lit.sum()) >= enough_to_show(error)
    # The edges may leave out a fifth of the flat pixels, a requirement of ours.
    assert (dark | lit).sum() > 0.8 * seen.flat.sum()
    return dark, lit


def blocked(triangles: Triangles, points: NDArray[np.float64], direction: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return (N,) bool, True if a ray from the point in a direction hits a surface."""
    hits: NDArray[np.bool_] = triangles.intersector.intersects_any(points, np.broadcast_to(direction, points.shape))
    return hits


def near_edges(labels: NDArray[np.integer]) -> NDArray[np.bool_]:
    """Return the pixels of which one of the eight neighbours has another label."""
    edges: NDArray[np.bool_] = maximum_filter(labels, 3) != minimum_filter(labels, 3)
    return edges


#: Pixels by which a rasterizer may move an edge: OpenGL rounds vertices to a grid of 1/256 (`GL_SUBPIXEL_BITS` is 8), at both
#: ends of the edge.
SNAP = 2 / 256


def assert_agrees(truth: GroundTruth, triangles: Triangles, camera: Camera, view: View, *, gaps: float = 0.0) -> Traced:
    """Fail unless rendered truth agrees with traced rays, and return these.

    Labels agree wherever rays around a pixel's centre, as far away as an edge may move, agree. Depths differ there by rounding,
    a tenth of a millimetre or 10⁻⁵, and by as much as those of these rays differ: at a crease, a pixel may show the other face.

    Args:
        gaps: largest share of pixels that show what is behind two meshes that touch without shared vertices, or miss what is
            thinner than an edge may move.
    """
    labels, instances, depth = traced = trace(triangles, camera, view)
    sure, spread = np.ones(labels.shape, np.bool_), np.zeros(labels.shape)
    for right, down in product((-SNAP, SNAP), repeat=2):
        other = trace(triangles, camera, view, right=right, down=down)
        sure &= (other[0] == labels) & (other[1] == instances)
        with np.errstate(invalid="ignore"):
            spread = np.fmax(spread, np.abs(other[2] - depth))
    assert sure.sum() >= enough_to_show(0.001)
    wrong = sure & ((truth.class_map != labels) | (truth.instance_map != instances))
    assert wrong.mean() <= gaps
    for rendered, other_labels in ((truth.class_map, labels), (truth.instance_map, instances)):
        assert not (wrong & (rendered != other_labels) & ~near_edges(rendered) & ~near_edges(other_labels)).any()
    sure &= ~wrong
    np.testing.assert_array_equal(np.isfinite(truth.depth[sure]), np.isfinite(depth[sure]))
    hit = sure & np.isfinite(depth)
    error = np.abs(truth.depth[hit] - depth[hit])
    assert (error > 1e-5 * np.maximum(depth[hit], 10.0) + spread[hit]).mean() <= gaps
    return traced
