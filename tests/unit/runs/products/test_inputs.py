from dataclasses import replace
from typing import Any

import pytest

from valerie.parameters.assignment import digest
from valerie.runs.products.inputs import EVALUATION_REVISION, FrameDigests, ProductInputs
from valerie.runs.products.pins import Pins
from valerie.runs.products.states import UPLOADED_ROUTE
from valerie.runs.resolving.spec import parse, resolve
from valerie.scene.assets.manifest import Manifest
from valerie.scene.variation.variant import split

X = "scene.person-1.pos.x"
FUNCTIONS = ["deeplabv3plus-small", "semantic-fpn-small"]


def frame(
    street: Manifest,
    pins: Pins,
    values: dict[str, Any],
    camera: int = 0,
    asset_digest: str = "a",
    **given: Any,
) -> FrameDigests:
    neutral = {"sensors": [{"auto_exposure": False}]}
    spec = parse({"name": "one", "asset": "urban-street", "functions": FUNCTIONS, **neutral, **given})
    return ProductInputs(resolve(spec, street), asset_digest=asset_digest, pins=pins).frame(values, camera)


def with_function(pins: Pins, name: str, **changes: Any) -> Pins:
    pin = pins.functions[name].model_copy(update=changes)
    return pins.model_copy(update={"functions": {**pins.functions, name: pin}})


def changed(before: FrameDigests, after: FrameDigests) -> set[str]:
    digests = {
        name
        for name in ("background", "layer", "truth")
        if getattr(before.products, name) != getattr(after.products, name)
    }
    pairs = list(zip(before.evaluations, after.evaluations, strict=False))
    digests |= {"prediction" for a, b in pairs if a.prediction != b.prediction}
    return digests | {"evaluation" for a, b in pairs if a.scores != b.scores}


def test_annotations_follow_the_truth_and_change_nothing_else(street: Manifest, pins: Pins) -> None:
    without, asked = frame(street, pins, {}), frame(street, pins, {}, annotations=["normals", "boxes"])
    assert without.annotations == ()
    assert changed(without, asked) == set()
    assert [(annotation.kind, annotation.inputs) for annotation in asked.annotations] == [
        ("normals", (asked.products.truth,)),
        ("boxes", (asked.products.truth,)),
    ]
    darker = frame(street, pins, {"scene.sun-1.azimuth": 100.0}, annotations=["boxes"])
    assert darker.annotations == asked.annotations[1:]
    moved = frame(street, pins, {X: 4.0}, annotations=["boxes"])
    assert moved.annotations[0].product != darker.annotations[0].product


def test_the_prediction_of_a_background_follows_from_it_alone_and_changes_evaluations_alone(
    street: Manifest, pins: Pins
) -> None:
    deep = {"name": "deep", "lens": {"f_number": 1.4, "focus_distance_m": 10}}
    sensors = [{"name": "plain"}, {"name": "dark", "exposure_ev": -2}, deep]
    plain, asked = (frame(street, pins, {}, sensors=sensors, infer_backgrounds=on) for on in (False, True))
    assert changed(plain, asked) == {"evaluation"}
    assert {evaluation.empty for evaluation in plain.evaluations} == {None}
    # One for each sensor and function; a defocused lens needs depths, which are those of the whole frame.
    assert len({evaluation.empty for evaluation in asked.evaluations if evaluation.sensor_index < 2}) == 4
    assert {evaluation.empty for evaluation in asked.evaluations if evaluation.sensor_index == 2} == {None}
    moved = frame(street, pins, {X: 4.0}, sensors=sensors, infer_backgrounds=True)
    assert [evaluation.empty for evaluation in moved.evaluations] == [
        evaluation.empty for evaluation in asked.evaluations
    ]
    uploaded = with_function(pins, FUNCTIONS[0], route=UPLOADED_ROUTE)
    first, second, *_ = frame(street, uploaded, {}, infer_backgrounds=True).evaluations
    assert first.empty is None
    assert second.empty is not None


MADE = {"prediction", "evaluation"}


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ({X: 4.0}, {"layer", "truth"} | MADE),
        ({"scene.person-1.character": "black-outfit"}, {"layer", "truth"} | MADE),
        ({"scene.person-1.cloth.metallic": 0.5}, {"layer"} | MADE),
        ({"scene.sun-1.azimuth": 100.0}, {"background", "layer"} | MADE),
        ({"scene.camera-1.yaw": 5.0}, {"background", "layer", "truth"} | MADE),
        ({"scene.camera-2.yaw": 5.0}, set()),
        ({"sensor.exposure_ev": 1.0}, MADE),
        ({"scene.person-2.pos.x": 4.0}, set()),
        ({X: 3}, set()),
        ({"scene.person-1.heading": 540.0}, set()),
        ({"scene.camera-1.yaw": -360.0}, set()),
    ],
)
def test_a_value_changes_only_the_products_that_depend_on_it(
    street: Manifest, pins: Pins, values: dict[str, Any], expected: set[str]
) -> None:
    # Person 2 is absent: where it would stand is no input of anything. Defaults that are spelled out change nothing.
    assert changed(frame(street, pins, {}), frame(street, pins, values)) == expected


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        (
            {
                "name": "two",
                "seed": 5,
                "description": "x",
                "requirements": [{"id": "R", "statistic": "mean(pacc) >= 0.8"}],
            },
            set(),
        ),
        ({"sensors": [{"name": "other"}]}, set()),
        ({"sensors": [{"exposure_ev": -1}]}, MADE),
        ({"sensors": [{"curve": "srgb"}]}, MADE),
        ({"renderer": "pyrender"}, {"background", "layer"} | MADE),
        ({"renderer": {"name": "raster"}}, set()),
        ({"resolution": {"width": 961, "height": 540}}, {"background", "layer", "truth"} | MADE),
        ({"asset": {"name": "urban-street", "seed": 3}}, set()),
        ({"functions": ["deeplabv3plus-small"]}, set()),
        ({"detection_threshold": 0.7}, set()),
    ],
)
def test_a_spec_changes_only_the_products_that_depend_on_it(
    street: Manifest, pins: Pins, given: dict[str, Any], expected: set[str]
) -> None:
    # The asset counts by its digest, which is the same here.
    assert changed(frame(street, pins, {}), frame(street, pins, {}, **given)) == expected


@pytest.mark.parametrize(
    ("role", "key", "expected"),
    [
        ("engine", "revision", {"background", "layer"} | MADE),
        ("engine", "numeric_class", {"background", "layer"} | MADE),
        ("engine", "route", set()),
        ("truth", "revision", {"truth", "evaluation"}),
        ("truth", "numeric_class", {"truth", "evaluation"}),
    ],
)
def test_revisions_and_numeric_classes_count_and_queues_do_not(
    street: Manifest, pins: Pins, role: str, key: str, expected: set[str]
) -> None:
    changes = {key: 2 if key == "revision" else "other"}
    other = pins.model_copy(update={role: getattr(pins, role).model_copy(update=changes)})
    assert changed(frame(street, pins, {}), frame(street, other, {})) == expected


@pytest.mark.parametrize("key", ["digest", "numeric_class", "revision"])
def test_a_functions_weights_revision_and_numeric_class_count_for_its_own_predictions(
    street: Manifest, pins: Pins, key: str
) -> None:
    name = FUNCTIONS[1]
    other = with_function(pins, name, **{key: 2 if key == "revision" else "other"})
    before, after = frame(street, pins, {}), frame(street, other, {})
    assert changed(before, after) == MADE
    assert before.evaluations[0] == after.evaluations[0]


def test_another_asset_changes_everything(street: Manifest, pins: Pins) -> None:
    assert changed(frame(street, pins, {}), frame(street, pins, {}, asset_digest="b")) == (
        {"background", "layer", "truth"} | MADE
    )


def test_a_sensor_value_of_the_variant_overrides_the_setting_and_the_assets_default_does_not(
    street: Manifest, pins: Pins
) -> None:
    dark = frame(street, pins, {}, sensors=[{"exposure_ev": -2}])
    assert changed(dark, frame(street, pins, {}, sensors=[{"exposure_ev": 0}])) == MADE
    as_value = frame(street, pins, {"sensor.exposure_ev": -2}, sensors=[{"exposure_ev": 1}])
    assert changed(dark, as_value) == set()


def test_every_sensor_and_function_has_its_prediction(street: Manifest, pins: Pins) -> None:
    evaluations = frame(street, pins, {}, sensors=[{"name": "a"}, {"name": "b", "gamma": 2}]).evaluations
    assert [(evaluation.sensor_index, evaluation.function_index) for evaluation in evaluations] == [
        (0, 0),
        (0, 1),
        (1, 0),
        (1, 1),
    ]
    assert (
        len({evaluation.prediction for evaluation in evaluations} | {evaluation.scores for evaluation in evaluations})
        == 8
    )


def test_each_camera_has_its_own_products(street: Manifest, pins: Pins) -> None:
    assert changed(frame(street, pins, {}, 0), frame(street, pins, {}, 1)) == ({"background", "layer", "truth"} | MADE)
    alone = frame(street, pins, {}, 0, cameras=["camera-2"])
    assert changed(alone, frame(street, pins, {}, 1)) == set()


def test_an_evaluation_follows_from_prediction_and_truth_alone(street: Manifest, pins: Pins) -> None:
    products = frame(street, pins, {})
    assert products.evaluations[0].scores == digest(
        1, "evaluation", EVALUATION_REVISION, products.evaluations[0].prediction, products.products.truth
    )
    inputs = split({}, street, "camera-1")
    engine = {"name": "raster", "revision": 1, "numeric_class": pins.engine.numeric_class}
    assert products.products.layer == digest(1, "layer", engine, products.products.background, inputs.layer)


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({"name": "cycles", "quality": "standard"}, set()),
        ({"name": "cycles", "samples": 64, "denoise": True}, set()),
        ({"name": "cycles", "clamp_indirect": 10}, set()),
        ({"name": "cycles", "samples": 65}, {"background", "layer"} | MADE),
        ({"name": "cycles", "seed": 1}, {"background", "layer"} | MADE),
    ],
)
def test_settings_of_an_engine_are_inputs_of_its_pictures_however_they_were_said(
    street: Manifest, pins: Pins, given: dict[str, Any], expected: set[str]
) -> None:
    plain = frame(street, pins, {}, renderer="cycles")
    assert changed(plain, frame(street, pins, {}, renderer=given)) == expected


def test_labels_change_the_evaluations_alone(street: Manifest, pins: Pins) -> None:
    exact = frame(street, pins, {})
    assert changed(exact, frame(street, pins, {}, labels="cityscapes")) == {"evaluation"}
    assert changed(exact, frame(street, pins, {}, labels="exact")) == set()


def test_classes_that_a_function_is_judged_by_change_its_evaluations_alone(street: Manifest, pins: Pins) -> None:
    def judged(*judged_by: str) -> FrameDigests:
        first = FUNCTIONS[0]
        card = replace(pins.functions[first].card, judged_by=judged_by)
        return frame(street, with_function(pins, first, card=card), {})

    whole = frame(street, pins, {})
    assert judged() == whole
    assert changed(whole, judged("person")) == {"evaluation"}
    assert judged("person").evaluations[1] == whole.evaluations[1]
    assert judged("person").evaluations[0] != judged("road").evaluations[0]
