"""Frames and their pictures through REST."""

from __future__ import annotations

import io
from collections import Counter
from typing import Any

import httpx
import numpy as np
import pytest
from PIL import Image

from tests.world.drawn import DrawnRuns
from tests.world.serving import every_item
from tests.world.world import settings_of
from valerie.labels import CITYSCAPES, PERSON, TRAIN_LABELS, TRAIN_NAMES, colorize
from valerie.measures import Source, names_from
from valerie.pipeline.base.context import open_context
from valerie.pipeline.reading.product_reader import ProductReader
from valerie.storage import codecs
from valerie.storage.keys import product_key


@pytest.fixture(scope="module")
def frame(api: httpx.Client, drawn: DrawnRuns) -> dict[str, Any]:
    """A frame with a visible person."""
    for item in api.get(f"/v1/runs/{drawn.finished}/frames").json()["items"]:
        detail: dict[str, Any] = api.get(f"/v1/frames/{item['id']}").json()
        if detail["persons"][0]["pixel_area"] > 10:
            return detail
    raise AssertionError("no person is visible in any frame")


def image(client: httpx.Client, address: str) -> np.ndarray[Any, Any]:
    answer = client.get(address)
    assert answer.headers["Content-Type"] == "image/png"
    return np.asarray(Image.open(io.BytesIO(answer.content)))


def test_frames_are_paged_in_the_order_of_variants_and_cameras(api: httpx.Client, drawn: DrawnRuns) -> None:
    path = f"/v1/runs/{drawn.finished}/frames"
    whole = api.get(path).json()["items"]
    places = [(run["variant_index"], run["camera"]) for run in whole]
    assert places == sorted(places)
    assert every_item(api, path, limit=11) == whole


def test_neighbours_lead_through_all_frames_and_back(api: httpx.Client, drawn: DrawnRuns) -> None:
    whole = [item["id"] for item in api.get(f"/v1/runs/{drawn.finished}/frames").json()["items"]]
    details = [api.get(f"/v1/frames/{run}").json() for run in whole]
    assert [detail["next"] for detail in details] == [*whole[1:], None]
    assert [detail["previous"] for detail in details] == [None, *whole[:-1]]


def test_neighbours_in_a_parameter_differ_in_nothing_else_and_rejected_variants_are_skipped(
    api: httpx.Client, drawn: DrawnRuns
) -> None:
    listed = api.get(f"/v1/runs/{drawn.finished}/frames", params={"limit": 1000}).json()["items"]
    frames = {one["id"]: api.get(f"/v1/frames/{one['id']}").json() for one in listed}
    seen = 0
    for frame in frames.values():
        for near in frame["neighbours"]:
            here = {**frame["assignment"], "camera": frame["camera"]}
            same = sorted(
                ({**one["assignment"], "camera": one["camera"]} for one in frames.values()),
                key=lambda values: (values[near["parameter"]] != "red-coat", values[near["parameter"]]),
            )
            line = [
                values[near["parameter"]]
                for values in same
                if all(values[k] == here[k] for k in here if k != near["parameter"])
            ]
            place = line.index(here[near["parameter"]])
            expected = (line[place - 1] if place else None, line[place + 1] if place + 1 < len(line) else None)
            assert tuple(side and side["value"] for side in (near["before"], near["after"])) == expected
            for side in filter(None, (near["before"], near["after"])):
                other = frames[side["frame"]]
                assert {**other["assignment"], "camera": other["camera"]} == {**here, near["parameter"]: side["value"]}
                seen += 1
    assert seen > 100
    parameters = {near["parameter"].removeprefix("scene.person-1.") for near in frame["neighbours"]}
    assert parameters == {"camera", "pos.x", "pos.y", "character"}


def test_visibility_and_scores_agree_with_the_stored_products(
    api: httpx.Client, drawn: DrawnRuns, frame: dict[str, Any]
) -> None:
    store = open_context(settings_of(drawn.folder)).store
    truth = ProductReader(store).truth(frame["truth"])
    person = frame["persons"][0]
    visible = truth.instance_map == person["instance_id"]
    assert person["pixel_area"] == visible.sum()
    assert person["pixel_area_percent"] == pytest.approx(100 * visible.mean())
    for one in frame["evaluations"]:
        predicted = codecs.decode_prediction(store.get(product_key("prediction", one["prediction"])))
        hit = int((visible & (predicted == PERSON.train_id)).sum())
        (scored,) = one["persons"]
        assert scored.keys() == {"instance_id", *names_from(Source.PERSON_SCORE)}
        expected = {
            "instance_id": person["instance_id"],
            "tp": hit,
            "fn": int(visible.sum()) - hit,
            "pacc": hit / visible.sum(),
            "pacc_empty": 0.0,  # the drawn functions see nobody where nobody stands
        }
        assert scored.items() >= expected.items()
        others = Counter(TRAIN_NAMES[train_id] for train_id in predicted[visible].tolist())
        del others[PERSON.name]
        assert one["called_instead"] == others
        assert [*one["called_instead"].values()] == sorted(others.values(), reverse=True)
    assert [evaluation["function"] for evaluation in frame["evaluations"]] == [
        "deeplabv3plus-small",
        "semantic-fpn-small",
    ]


def test_a_pixel_names_what_the_stored_products_hold_there(
    api: httpx.Client, drawn: DrawnRuns, frame: dict[str, Any]
) -> None:
    store = open_context(settings_of(drawn.folder)).store
    truth = ProductReader(store).truth(frame["truth"])
    predictions = {
        one["function"]: codecs.decode_prediction(store.get(product_key("prediction", one["prediction"])))
        for one in frame["evaluations"]
    }
    person = tuple(np.argwhere(truth.instance_map == frame["persons"][0]["instance_id"])[0])
    sky = tuple(np.argwhere(~np.isfinite(truth.depth))[0])
    for y, x in (person, sky, (frame["height"] - 1, frame["width"] - 1)):
        (seen,) = api.get(f"/v1/frames/{frame['id']}/pixel", params={"x": int(x), "y": int(y)}).json()
        depth = float(truth.depth[y, x])
        assert seen == {
            "sensor": "default",
            "label": next(one.name for one in CITYSCAPES if one.id == truth.class_map[y, x]),
            "instance_id": int(truth.instance_map[y, x]) or None,
            "depth_m": depth if np.isfinite(depth) else None,
            "predictions": {
                name: next((one.name for one in TRAIN_LABELS if one.train_id == labels[y, x]), "void")
                for name, labels in predictions.items()
            },
        }
    outside = api.get(f"/v1/frames/{frame['id']}/pixel", params={"x": frame["width"], "y": 0})
    assert outside.status_code == 422
    assert outside.json()["errors"][0] == {
        "field": "x",
        "message": "outside the frame",
        "value": frame["width"],
        "limit": f"0 … {frame['width'] - 1}",
    }


def test_every_address_of_a_frame_shows_a_picture_of_its_size(api: httpx.Client, frame: dict[str, Any]) -> None:
    addresses = [*frame["images"].values(), *(value for e in frame["evaluations"] for value in e["images"].values())]
    assert len(addresses) == 5 + 2 * 4
    assert {image(api, address).shape for address in addresses} == {(frame["height"], frame["width"], 3)}


def test_truth_and_prediction_are_painted_in_the_colours_of_their_classes(
    api: httpx.Client, drawn: DrawnRuns, frame: dict[str, Any]
) -> None:
    store = open_context(settings_of(drawn.folder)).store
    truth = ProductReader(store).truth(frame["truth"])
    assert (image(api, frame["images"]["truth"]) == colorize(truth.class_map)).all()
    evaluation = frame["evaluations"][1]
    predicted = codecs.decode_prediction(store.get(product_key("prediction", evaluation["prediction"])))
    shown = image(api, evaluation["images"]["prediction"])
    assert (shown[predicted == PERSON.train_id] == PERSON.color).all()


def test_the_errors_picture_marks_found_missed_and_false_pixels(api: httpx.Client, frame: dict[str, Any]) -> None:
    evaluation = frame["evaluations"][0]
    shown = image(api, evaluation["images"]["errors"]).astype(int)
    coloured = (shown.max(axis=2) - shown.min(axis=2)) > 20
    assert coloured.sum() == evaluation["tp"] + evaluation["fn"] + evaluation["fp"]


def test_a_known_picture_is_not_sent_again(api: httpx.Client, frame: dict[str, Any]) -> None:
    address = frame["images"]["picture"]
    first = api.get(address)
    again = api.get(address, headers={"If-None-Match": f'"other", W/{first.headers["ETag"]}'})
    assert (again.status_code, again.content) == (304, b"")
    assert again.headers["ETag"] == first.headers["ETag"]
    assert api.get(address, headers={"If-None-Match": '"other"'}).status_code == 200


def test_different_pictures_have_different_tags(api: httpx.Client, frame: dict[str, Any]) -> None:
    # The pictures of a frame and of an evaluation behind the same sensor are one, so they are not compared.
    addresses = [
        *frame["images"].values(),
        *(e["images"][k] for e in frame["evaluations"] for k in ("prediction", "errors")),
    ]
    assert len({api.get(address).headers["ETag"] for address in addresses}) == len(addresses)


@pytest.mark.parametrize(
    ("wanted", "slice_"),
    [("bytes=0-99", slice(0, 100)), ("bytes=100-", slice(100, None)), ("bytes=-50", slice(-50, None)),
     ("bytes=10-999999999", slice(10, None))],
)  # fmt: skip
def test_a_range_gives_that_part_of_the_object(
    api: httpx.Client, frame: dict[str, Any], wanted: str, slice_: slice
) -> None:
    for address in (frame["images"]["truth"], f"/v1/artifacts/truth/{frame['truth']}"):
        whole = api.get(address).content
        part = api.get(address, headers={"Range": wanted})
        assert part.status_code == 206
        assert part.content == whole[slice_]
        start = slice_.indices(len(whole))[0]
        assert part.headers["Content-Range"] == f"bytes {start}-{start + len(part.content) - 1}/{len(whole)}"


@pytest.mark.parametrize("wanted", ["bytes=999999999-", "bytes=-0"])
def test_a_range_beyond_the_end_is_refused_with_the_size(api: httpx.Client, frame: dict[str, Any], wanted: str) -> None:
    address = f"/v1/artifacts/layer/{frame['layer']}"
    size = len(api.get(address).content)
    answer = api.get(address, headers={"Range": wanted})
    assert (answer.status_code, answer.headers["Content-Range"]) == (416, f"bytes */{size}")
    assert answer.headers["Content-Type"] == "application/problem+json"
    assert answer.json()["errors"][0] == {
        "field": "range", "message": "begins beyond the end", "value": wanted, "limit": size,
    }  # fmt: skip


@pytest.mark.parametrize("wanted", ["bytes=9-3", "bytes=0-1,4-5", "lines=1-2", "bytes=a-b", "bytes=²-3"])
def test_anything_but_a_single_range_is_ignored(api: httpx.Client, frame: dict[str, Any], wanted: str) -> None:
    headers = [(b"range", wanted.encode("latin-1"))]  # raw bytes, since the client refuses text that is not ASCII
    answer = api.get(f"/v1/artifacts/layer/{frame['layer']}", headers=headers)
    assert answer.status_code == 200


def test_a_range_of_another_version_gives_the_whole_object(api: httpx.Client, frame: dict[str, Any]) -> None:
    address = f"/v1/artifacts/truth/{frame['truth']}"
    etag = api.get(address).headers["ETag"]
    assert api.get(address, headers={"Range": "bytes=0-9", "If-Range": etag}).status_code == 206
    assert api.get(address, headers={"Range": "bytes=0-9", "If-Range": '"old"'}).status_code == 200


def test_an_artifact_is_the_stored_object(api: httpx.Client, drawn: DrawnRuns, frame: dict[str, Any]) -> None:
    store = open_context(settings_of(drawn.folder)).store
    prediction = frame["evaluations"][0]["prediction"]
    for kind, digest in (("background", frame["background"]), ("prediction", prediction)):
        assert api.get(f"/v1/artifacts/{kind}/{digest}").content == store.get(product_key(kind, digest))


def test_a_failed_frame_has_its_state_and_the_pictures_that_exist(api: httpx.Client, drawn: DrawnRuns) -> None:
    detail = api.get(f"/v1/frames/{drawn.failed}.4.0.0").json()
    assert detail["state"] == "failed"
    assert {evaluation["state"] for evaluation in detail["evaluations"]} == {"failed"}
    assert api.get(detail["images"]["truth"]).status_code == 200
    answer = api.get(detail["images"]["picture"])
    assert answer.status_code == 409
    assert "failed" in answer.json()["detail"]


def test_an_annotation_that_the_run_does_not_have_is_refused(api: httpx.Client, frame: dict[str, Any]) -> None:
    answer = api.get(f"/v1/frames/{frame['id']}/annotations/normals")
    assert answer.status_code == 422
    assert answer.json()["errors"][0]["field"] == "annotations"
    assert api.get(f"/v1/frames/{frame['run_id']}.99.0.0/annotations/normals").status_code == 404


def test_unknown_names_of_a_picture_are_refused_with_near_matches(api: httpx.Client, frame: dict[str, Any]) -> None:
    for parameter, name, near in (
        ("kind", "pictur", "picture"),
        ("function", "semantic-fpn", "semantic-fpn-small"),
        ("sensor", "defualt", "default"),
    ):
        answer = api.get(f"/v1/frames/{frame['id']}/image", params={parameter: name})
        assert answer.status_code == 422
        assert f"did you mean {near}" in answer.json()["detail"]
        assert answer.json()["errors"][0]["field"] == parameter
