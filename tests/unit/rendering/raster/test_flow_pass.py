"""Optical flow against rays through pixel centres, and against displacements computed by hand."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.sampling import enough_to_show
from tests.unit.rendering.scene_rays import footprints, near_edges, pixel_rays, triangles_of
from valerie.parameters.definitions import Value
from valerie.rendering.base import View
from valerie.rendering.ground_truth import TruthPass
from valerie.rendering.raster.flow_pass import FlowPass, still_flow
from valerie.scene.graph.model import Camera, Scene
from valerie.scene.graph.transforms import camera_transform
from valerie.scene.variation.variant import apply
from valerie.testing.assets import simple_asset

pytestmark = pytest.mark.gl

VIEW = View("camera-1", 320, 180)
PERSON = "scene.person-1"
FOCAL = 35.0 / 36.0 * VIEW.width
#: Rounding of flow, pixels: positions of 8 to 16 m have steps of 2⁻²⁰ m in single precision, and the nearest body stands 5 m
#: away. Half a step at both moments and in both coordinates of a projection.
ROUNDING = 2 * FOCAL / 5.0 * 2.0**-20


@pytest.fixture(scope="module")
def flows() -> Iterator[FlowPass]:
    flow_pass = FlowPass()
    yield flow_pass
    flow_pass.close()


def scene(**values: Value) -> Scene:
    return apply({path.replace("__", "."): value for path, value in values.items()}, simple_asset())


def at(x: float, y: float, heading: float = 180.0, camera_x: float = 0.0) -> Scene:
    values: dict[str, Value] = {f"{PERSON}.pos.x": x, f"{PERSON}.pos.y": y, f"{PERSON}.heading": heading}
    return apply({**values, "scene.camera-1.pos.x": camera_x}, simple_asset())


def with_camera(scene: Scene, position: tuple[float, float, float], yaw: float, pitch: float, roll: float) -> Scene:
    camera = replace(scene.cameras["camera-1"], transform=camera_transform(position, yaw, pitch, roll))
    return replace(scene, cameras={**scene.cameras, "camera-1": camera})


def traced_flow(now: Scene, then: Scene) -> NDArray[np.float64]:
    """Return the flow by ray tracing: find the point of a triangle that each ray hits, and project it at the other moment."""
    camera, other = now.cameras[VIEW.camera], then.cameras[VIEW.camera]
    triangles, moved = (triangles_of(scene).intersector.mesh.triangles for scene in (now, then))
    rays = pixel_rays(camera, VIEW).reshape(-1, 3)
    origins = np.broadcast_to(camera.position, rays.shape)
    hit = triangles_of(now).intersector.intersects_first(origins, rays)
    a, b, c = (triangles[hit][:, k] for k in range(3))
    normal = np.cross(b - a, c - a)
    with np.errstate(divide="ignore", invalid="ignore"):
        points = origins + rays * (((a - origins) * normal).sum(1) / (rays * normal).sum(1))[:, None]
        area = (normal * normal).sum(1)
        shares = [(np.cross(q - p, points - p) * normal).sum(1) / area for p, q in ((b, c), (c, a), (a, b))]
    then_points = sum(share[:, None] * moved[hit][:, k] for k, share in enumerate(shares))
    then_points[hit < 0] = other.position + 1e9 * rays[hit < 0]
    local = (then_points - other.position) @ other.transform[:3, :3]
    x = VIEW.width / 2 + FOCAL * local[:, 0] / -local[:, 2]
    y = VIEW.height / 2 - FOCAL * local[:, 1] / -local[:, 2]
    pixels = np.stack([x, y], axis=1).reshape(VIEW.height, VIEW.width, 2)
    rows, columns = np.mgrid[0 : VIEW.height, 0 : VIEW.width]
    pixels[local[:, 2].reshape(VIEW.height, VIEW.width) >= 0] = np.nan
    return pixels - np.stack([columns + 0.5, rows + 0.5], axis=2)


def stretched(scene: Scene) -> Scene:
    """Stretch the person's body: another mesh with the same triangles."""
    path = f"{PERSON}.red-coat"
    node = scene.nodes[path]
    meshes = tuple(
        replace(mesh, positions=(mesh.positions * np.array([1.2, 1.0, 1.5], np.float32))) for mesh in node.meshes
    )
    return replace(scene, nodes={**scene.nodes, path: replace(node, meshes=meshes)})


CASES = {
    "a person walks and turns": (at(-1, 9), at(-0.3, 8.5, 200)),
    "a person walks towards the camera": (at(0, 9), at(0, 3)),
    "the camera moves": (at(0, 9), at(0, 9, camera_x=0.4)),
    "the camera moves, turns and rolls": (at(0, 9), with_camera(at(0, 9), (0.3, -1.0, 1.6), 4.0, -2.0, 3.0)),
    "both move": (at(-1, 9, camera_x=-0.5), with_camera(at(0, 8, 160), (0.3, -1.5, 1.6), 3.0, 1.0, 0.0)),
    "a body changes its shape as it walks": (at(-1, 9), stretched(at(-0.5, 9, 190))),
}


@pytest.mark.parametrize("case", CASES)
def test_flow_leads_to_the_traced_point_of_the_same_triangle(case: str, flows: FlowPass, truth_pass: TruthPass) -> None:
    now, then = CASES[case]
    truth = truth_pass.truth(now, VIEW)
    flow, expected = flows.flow(now, then, VIEW, truth), traced_flow(now, then)
    inside = ~near_edges(truth.class_map.astype(np.int64) * 65536 + truth.instance_map)
    # Near an inner edge of an object, a ray may hit another of its sides than the drawn point lies on.
    inside &= footprints(triangles_of(now), now.cameras[VIEW.camera], VIEW).flat | np.isinf(truth.depth)
    assert np.array_equal(np.isnan(flow[inside]), np.isnan(expected[inside]))
    assert np.nanmax(np.abs(flow - expected).max(axis=2)[inside]) < ROUNDING
    assert ((truth.instance_map == 24001) & inside).sum() >= enough_to_show(0.01)


def test_a_step_to_the_side_moves_the_front_by_focal_length_times_step_over_depth(
    flows: FlowPass, truth_pass: TruthPass
) -> None:
    now, then = at(0.0, 10.0), at(0.5, 10.0)
    truth = truth_pass.truth(now, VIEW)
    flow = flows.flow(now, then, VIEW, truth)
    # The coat's front is the plane y = 9.8; the camera stands at y = −2. It is 0.5 m wide and 1.5 m high, and has half a pixel
    # more or less on each side.
    front = (truth.instance_map == 24001) & (np.abs(truth.depth - 11.8) < 1e-4)
    width, height = 0.5 * FOCAL / 11.8, 1.5 * FOCAL / 11.8
    assert front.sum() == pytest.approx(width * height, abs=width + height)
    expected = FOCAL * 0.5 / 11.8
    assert flow[front] == pytest.approx(np.tile([expected, 0.0], (int(front.sum()), 1)), abs=ROUNDING)
    still = truth.instance_map != 24001
    assert np.all(flow[still] == 0.0)


def test_a_person_who_does_not_move_has_no_flow(flows: FlowPass, truth_pass: TruthPass) -> None:
    now = at(0, 9)
    flow = flows.flow(now, at(0, 9), VIEW, truth_pass.truth(now, VIEW))
    assert float(np.abs(flow).max()) < ROUNDING


def test_flow_leads_to_the_same_object_at_the_other_moment(flows: FlowPass, truth_pass: TruthPass) -> None:
    now, then = at(-1, 9, camera_x=-0.2), at(-0.4, 9, camera_x=0.2)
    first, second = truth_pass.truth(now, VIEW), truth_pass.truth(then, VIEW)
    flow = flows.flow(now, then, VIEW, first)
    rows, columns = np.mgrid[0 : VIEW.height, 0 : VIEW.width]
    x, y = np.floor(columns + 0.5 + flow[..., 0]).astype(int), np.floor(rows + 0.5 + flow[..., 1]).astype(int)
    labels = [truth.class_map.astype(np.int64) * 65536 + truth.instance_map for truth in (first, second)]
    inside = (x >= 0) & (x < VIEW.width) & (y >= 0) & (y < VIEW.height) & ~near_edges(labels[0])
    inside[inside] = ~near_edges(labels[1])[y[inside], x[inside]]
    there = labels[1][y[inside], x[inside]]
    # Only points that a nearer object hides at the other moment may differ.
    covered = second.depth[y[inside], x[inside]] < first.depth[inside] - 0.3
    assert ((there == labels[0][inside]) | covered).all()
    assert not covered.all()


def test_flow_is_undefined_where_an_object_is_absent_then(flows: FlowPass, truth_pass: TruthPass) -> None:
    now = at(0, 9)
    truth = truth_pass.truth(now, VIEW)
    flow = flows.flow(now, scene(**{"scene__person-1__character": "absent"}), VIEW, truth)
    assert np.array_equal(np.isnan(flow).any(axis=2), truth.instance_map == 24001)


def test_flow_is_undefined_behind_the_camera() -> None:
    depth = np.full((4, 6), 2.0, np.float32)
    here, there = (Camera("scene.camera-1", camera_transform((0, y, 0), 0, 0, 0), 35.0) for y in (0.0, 3.0))
    assert np.isnan(still_flow(depth, here, there)).all()


def test_the_sky_moves_as_the_camera_turns_and_not_as_it_walks() -> None:
    depth = np.full((181, 321), np.inf, np.float32)
    here, walked, turned = (
        Camera("scene.camera-1", camera_transform((0, y, 0), yaw, 0, 0), 35.0) for y, yaw in ((0, 0), (5, 0), (0, 2))
    )
    # Columns up to 321 are rounded in double precision.
    assert float(np.abs(still_flow(depth, here, walked)).max()) <= 2 * np.spacing(321.0)
    focal = 35.0 / 36.0 * 321
    # The middle of the image is the optical axis.
    assert still_flow(depth, here, turned)[90, 160] == pytest.approx([focal * np.tan(np.radians(2)), 0.0], abs=1e-4)


def test_velocity_is_pixels_per_second_and_bodies_move_as_a_whole(flows: FlowPass, truth_pass: TruthPass) -> None:
    now, after = (at(x, 10.0) for x in (0.0, 0.01))
    truth = truth_pass.truth(now, VIEW)
    front = (truth.instance_map == 24001) & (np.abs(truth.depth - 11.8) < 1e-4)
    for late in (after, stretched(after)):
        velocity = flows.velocity(now, late, VIEW, truth, seconds=0.005)
        expected = np.tile([FOCAL * 2.0 / 11.8, 0.0], (int(front.sum()), 1))
        assert velocity[front] == pytest.approx(expected, abs=ROUNDING / 0.005)
        assert np.all(velocity[truth.instance_map != 24001] == 0.0)
