"""The joints of a person of the street among boxes."""

from __future__ import annotations

from dataclasses import replace

import pytest

from tests.unit.rendering.test_joints import PERSON, VIEW, joints_of, with_joints
from urban_street.human.figure import figure
from valerie.rendering.annotations.joints import SELF_HIDDEN, VISIBLE
from valerie.rendering.ground_truth import TruthPass
from valerie.scene.graph.model import JOINTS, Material


@pytest.mark.gl
def test_the_joints_of_a_generated_person_lie_on_its_body(truth_pass: TruthPass) -> None:
    body = figure("yellow-shirt")
    scene = with_joints(body.joints, y=6.0, heading=180.0)
    node = scene.nodes["scene.person-1.red-coat"]
    scene = replace(
        scene,
        nodes={**scene.nodes, node.path: replace(node, figure=body, meshes=body.meshes)},
        materials={**scene.materials, **{mesh.material: Material(mesh.material) for mesh in body.meshes}},
    )
    truth = truth_pass.truth(scene, VIEW)
    joints = joints_of(scene, truth)
    mask = truth.instance_map == PERSON
    x, y = joints.pixels[0].astype(int).T
    on_the_body = {name for name, inside in zip(JOINTS, mask[y, x], strict=True) if inside}
    assert set(JOINTS) - on_the_body <= {"head_top"}
    # Nothing stands in front of it: only the body itself hides joints, and face and shoulders are visible.
    flags = dict(zip(JOINTS, joints.visibility[0].tolist(), strict=True))
    assert set(flags.values()) <= {VISIBLE, SELF_HIDDEN}
    assert {flags[name] for name in ("left_eye", "right_eye", "left_shoulder", "right_shoulder", "right_knee")} == {
        VISIBLE
    }
    # Seen from the front, its left is on the right.
    pixels = dict(zip(JOINTS, joints.pixels[0].tolist(), strict=True))
    assert pixels["left_shoulder"][0] > pixels["right_shoulder"][0]
