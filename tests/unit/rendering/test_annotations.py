"""Normals and boxes against values computed by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.sampling import enough_to_show
from tests.unit.rendering.scene_rays import footprints, triangles_of
from valerie.rendering.annotations.boxes import EDGES, Boxes, measure_boxes
from valerie.rendering.annotations.normals import NOTHING, Normals
from valerie.rendering.base import GroundTruth, View
from valerie.rendering.ground_truth import TruthPass
from valerie.scene.graph.model import Material, Node, Scene, Texture
from valerie.scene.graph.transforms import camera_transform
from valerie.scene.variation.variant import apply
from valerie.testing.assets import box_mesh, simple_asset

VIEW = View("camera-1", 320, 180)
PERSON, CAR = 24001, 26001


def empty_truth(view: View) -> GroundTruth:
    shape = (view.height, view.width)
    return GroundTruth(np.zeros(shape, np.uint8), np.zeros(shape, np.uint16), np.full(shape, np.inf, np.float32), ())


def boxes_of(scene: Scene, view: View = VIEW) -> Boxes:
    return measure_boxes(scene, view, empty_truth(view))


def row_of(boxes: Boxes, instance: int) -> int:
    return boxes.instances.tolist().index(instance)


class TestOctahedralMap:
    @given(st.lists(st.floats(-1, 1), min_size=3, max_size=3).filter(lambda v: math.hypot(*v) > 0.01))
    def test_a_vector_comes_back_within_four_thousandths_of_a_degree(self, vector: list[float]) -> None:
        unit = np.array(vector) / math.hypot(*vector)
        back = Normals.of(unit.reshape(1, 1, 3)).vectors()[0, 0].astype(np.float64)
        # Half a step of 16 bits, 1.5e-5, on two axes and twice that on the third, at a length of at least 1/√3.
        assert np.rad2deg(np.linalg.norm(back - unit)) < 0.004

    def test_the_code_of_no_surface_differs_from_every_direction(self) -> None:
        normals = Normals.of(np.array([[[0, 0, 0], [0, 0, -1], [-1, 0, 0]]], np.float64))
        assert normals.defined.tolist() == [[False, True, True]]
        assert normals.octahedral[0, 0].tolist() == [NOTHING, NOTHING]
        np.testing.assert_allclose(normals.vectors()[0], [[0, 0, 0], [0, 0, -1], [-1, 0, 0]], atol=1e-6)


@pytest.mark.gl
class TestNormals:
    def test_they_are_the_directions_of_the_planes_that_rays_hit(self, truth_pass: TruthPass) -> None:
        scene = apply({"scene.person-1.heading": 33.0, "scene.person-1.pos.x": 1.2}, simple_asset())
        surfaces = footprints(triangles_of(scene), scene.cameras[VIEW.camera], VIEW)
        assert surfaces.flat.sum() >= enough_to_show(0.001)
        normals = truth_pass.normals(scene, VIEW).vectors()
        # The octahedral code is exact to four thousandths of a degree, see above.
        np.testing.assert_allclose(normals[surfaces.flat], surfaces.normals[surfaces.flat], atol=np.deg2rad(0.004))

    def test_they_are_aligned_with_depth_even_where_leaves_are_cut_out(self, truth_pass: TruthPass) -> None:
        # A box of leaves before the first camera, with a hole in every second stripe of its sides.
        base = simple_asset().base
        stripes = np.full((64, 64, 4), 255, np.uint8)
        stripes[:, np.arange(64) // 8 % 2 == 1, 3] = 0
        leaves = Node("scene.vegetation-1", np.eye(4), (box_mesh((-1, 4, 1), (1, 6, 3), "leaves"),), label_id=21)
        scene = replace(
            base,
            nodes={**base.nodes, leaves.path: leaves},
            materials={**base.materials, "leaves": Material("leaves", base_color_texture="leaves", alpha_cutoff=0.5)},
            textures={**base.textures, "leaves": Texture("leaves", stripes)},
        )
        truth, normals = truth_pass.truth(scene, VIEW), truth_pass.normals(scene, VIEW)
        rows, columns = np.nonzero(truth.class_map == 21)
        inside = truth.class_map[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]
        # Four stripes and the three holes between them, each with half a pixel more or less at its edges.
        assert (inside == 21).mean() == pytest.approx(4 / 7, abs=4 / inside.shape[1])
        assert np.isinf(truth.depth[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]).any()
        assert np.array_equal(normals.defined, np.isfinite(truth.depth))
        lengths = np.linalg.norm(normals.vectors()[normals.defined], axis=1)
        np.testing.assert_allclose(lengths, 1.0, atol=1e-6)

    def test_a_frame_in_between_leaves_no_trace(self, truth_pass: TruthPass) -> None:
        scene = simple_asset().base
        first = truth_pass.normals(scene, VIEW)
        truth_pass.normals(apply({"scene.person-1.pos.x": -1.0}, simple_asset()), VIEW)
        assert np.array_equal(truth_pass.normals(scene, VIEW).octahedral, first.octahedral)


class TestBoxes:
    def test_a_person_of_known_size_stands_in_a_box_of_that_size(self) -> None:
        boxes = boxes_of(simple_asset().base)
        i = row_of(boxes, PERSON)
        np.testing.assert_allclose(boxes.centres[i], (0.0, 10.0, 0.9), atol=1e-6)
        np.testing.assert_allclose(boxes.sizes[i], (0.5, 0.4, 1.8), atol=1e-6)
        assert boxes.headings_deg[i] == pytest.approx(180.0)

    @pytest.mark.parametrize("heading", [0.0, 37.0, 90.0, 200.0, 359.0])
    def test_a_turned_box_keeps_its_size_and_has_its_heading(self, heading: float) -> None:
        boxes = boxes_of(apply({"scene.person-1.heading": heading}, simple_asset()))
        i = row_of(boxes, PERSON)
        np.testing.assert_allclose(boxes.sizes[i], (0.5, 0.4, 1.8), atol=1e-5)
        assert boxes.headings_deg[i] == pytest.approx(heading, abs=1e-4)
        # The front is where the heading points: counter-clockwise from +y.
        ahead = boxes.corners[i][[2, 3, 6, 7]].mean(axis=0) - boxes.centres[i]
        turn = math.radians(heading)
        np.testing.assert_allclose(ahead, (-0.2 * math.sin(turn), 0.2 * math.cos(turn), 0.0), atol=1e-5)

    def test_camera_centres_and_headings_are_relative_to_the_camera(self) -> None:
        base = simple_asset().base
        camera = replace(base.cameras["camera-1"], transform=camera_transform((2.0, 10.0, 0.9), 90.0, 0.0, 0.0))
        boxes = boxes_of(replace(base, cameras={"camera-1": camera}))
        i = row_of(boxes, PERSON)
        # The camera looks along −x from (2, 10, 0.9). The person's centre is 2 m ahead, and its heading of 180° is to the left.
        np.testing.assert_allclose(boxes.camera_centres[i], (0.0, 0.0, -2.0), atol=1e-6)
        assert boxes.camera_headings_deg[i] == pytest.approx(90.0)

    def test_the_projection_of_a_box_follows_the_pinhole_formula(self) -> None:
        base = simple_asset().base
        camera = replace(base.cameras["camera-1"], transform=camera_transform((0.0, 0.0, 0.9), 0.0, 0.0, 0.0))
        boxes = boxes_of(replace(base, cameras={"camera-1": camera}))
        focal = camera.focal_length_mm / 36.0 * VIEW.width
        i = row_of(boxes, PERSON)
        # The nearest face is 9.8 m in front of the camera, 0.5 m wide up to 1.5 m, and reaches 0.9 m below the axis.
        left, top, right, bottom = boxes.projected_boxes[i]
        assert (left, right) == pytest.approx((160 - focal * 0.25 / 9.8, 160 + focal * 0.25 / 9.8))
        assert bottom == pytest.approx(90 + focal * 0.9 / 9.8)
        assert 90 - focal * 0.9 / 9.8 < top < 90 - focal * 0.9 / 10.2
        np.testing.assert_allclose(
            boxes.projected_corners[i].max(axis=0), (160 + focal * 0.25 / 9.8, 90 + focal * 0.9 / 9.8), rtol=1e-5
        )

    def test_an_instance_behind_the_camera_has_no_projection(self) -> None:
        base = simple_asset().base
        camera = replace(base.cameras["camera-1"], transform=camera_transform((0.0, 20.0, 1.5), 0.0, 0.0, 0.0))
        boxes = boxes_of(replace(base, cameras={"camera-1": camera}))
        i = row_of(boxes, PERSON)
        assert np.isnan(boxes.projected_boxes[i]).all()
        assert np.isnan(boxes.projected_corners[i]).all()
        assert boxes.camera_centres[i][2] > 0

    def test_an_instance_that_reaches_behind_the_camera_is_bounded_by_its_part_in_front(self) -> None:
        base = simple_asset().base
        car = base.world_transform("scene.car-1")[:3, 3]
        camera = replace(base.cameras["camera-1"], transform=camera_transform((*car[:2], 0.7), 0.0, 0.0, 0.0))
        box = boxes_of(replace(base, cameras={"camera-1": camera})).projected_boxes
        left, top, right, bottom = box[row_of(boxes_of(base), CAR)]
        # From the inside, the car fills the image.
        assert left < 0
        assert top < 0
        assert right > VIEW.width
        assert bottom > VIEW.height

    @pytest.mark.gl
    def test_visible_pixels_lie_within_the_projection(self, truth_pass: TruthPass) -> None:
        scene = apply({"scene.person-1.pos.x": 2.0, "scene.person-1.pos.y": 12.0}, simple_asset())
        truth = truth_pass.truth(scene, VIEW)
        boxes = measure_boxes(scene, VIEW, truth)
        for i, instance in enumerate(boxes.instances.tolist()):
            mask = truth.instance_map == instance
            assert boxes.pixel_areas[i] == mask.sum()
            if mask.any():
                rows, columns = np.nonzero(mask)
                x0, y0, x1, y1 = boxes.visible_boxes[i].tolist()
                assert (x0, y0, x1, y1) == (columns.min(), rows.min(), columns.max() + 1, rows.max() + 1)
                left, top, right, bottom = boxes.projected_boxes[i].tolist()
                assert left < x0 + 1
                assert top < y0 + 1
                assert right > x1 - 1
                assert bottom > y1 - 1
        # For a person within the image, the projection is as tight as the amodal mask.
        (person,) = truth.persons
        rows, columns = np.nonzero(person.amodal)
        whole = (columns.min(), rows.min(), columns.max() + 1, rows.max() + 1)
        np.testing.assert_allclose(boxes.projected_boxes[row_of(boxes, PERSON)], whole, atol=1.0)

    def test_a_person_who_is_absent_has_no_box(self) -> None:
        assert boxes_of(simple_asset().base).instances.tolist() == [PERSON, CAR]

    def test_edges_join_corners_that_differ_in_one_direction_only(self) -> None:
        boxes = boxes_of(apply({"scene.person-1.heading": 0.0}, simple_asset()))
        corners = boxes.corners[row_of(boxes, PERSON)]
        assert len(set(EDGES)) == 12
        # Coordinates of 10 m in single precision.
        assert all((np.abs(corners[a] - corners[b]) > 1e-6).sum() == 1 for a, b in EDGES)
