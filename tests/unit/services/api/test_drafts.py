"""Specs that are being written, through REST."""

from __future__ import annotations

import base64
import io
from typing import Any

import httpx
import numpy as np
import pytest
from PIL import Image

from tests.world.drawn import ASSET, DrawnRuns, spec
from valerie import plugins
from valerie.rendering.base import View
from valerie.runs.document.schema import run_spec_schema
from valerie.runs.resolving.sensors import setting_of
from valerie.runs.resolving.spec import parse, resolve
from valerie.scene.assets.asset import asset_manifest, load_asset
from valerie.scene.variation.variant import apply
from valerie.sensing.metering import metered_ev
from valerie.sensing.sensor import Shot, develop

TEXT = f"name: n  # mine\nasset: {ASSET}\nvary:\n  person-1.pos.x: {{homogeneous: {{from: 1, to: 5, step: 1}}}}\n"


def test_a_change_keeps_the_text_and_gives_the_values_of_the_form(api: httpx.Client) -> None:
    change = {"kind": "field", "field": "name", "value": "second"}
    answer = api.post("/v1/draft", json={"text": TEXT, "changes": [change]}).json()
    assert answer["text"] == TEXT.replace("name: n", "name: second")
    assert answer["fields"]["asset"] == ASSET
    varied = {"parameter": "person-1.pos.x", "distribution": "HOMOGENEOUS", "minimum": 1, "maximum": 5, "step": 1}
    assert answer["vary"] == [{"place": "vary.person-1.pos.x", "document": varied}]
    assert answer["lines"]["vary.person-1.pos.x"] == 4


def test_a_text_that_is_no_document_is_a_problem_with_its_line(api: httpx.Client) -> None:
    answer = api.post("/v1/draft", json={"text": "name: [\n", "changes": []})
    assert answer.status_code == 422
    assert "line 2" in answer.json()["detail"]


def test_the_draft_of_a_run_submits_an_equal_spec(fresh: httpx.Client, drawn: DrawnRuns) -> None:
    text = fresh.get(f"/v1/runs/{drawn.finished}/draft").json()["text"]
    again = fresh.post("/v1/runs", content=text, headers={"Content-Type": "application/yaml"}).json()
    assert again["spec_digest"] == fresh.get(f"/v1/runs/{drawn.finished}").json()["spec_digest"]


def test_the_schema_is_that_of_the_file(api: httpx.Client) -> None:
    assert api.get("/v1/schema").json() == run_spec_schema()


@pytest.mark.parametrize(
    ("query", "field"),
    [({"variant": 24}, "variant"), ({"variant": 0, "camera": "camera-9"}, "camera"), ({"variant": [0] * 5}, "variant")],
)
def test_a_preview_of_nothing_is_refused_before_anything_is_rendered(
    api: httpx.Client, query: dict[str, Any], field: str
) -> None:
    answer = api.post("/v1/preview", params=query, json=spec("n"))
    assert answer.status_code == 422
    assert answer.json()["errors"][0]["field"] == field


def test_a_rejected_variant_has_a_reason_and_no_picture(api: httpx.Client) -> None:
    plan = api.post("/v1/plan", json=spec("n")).json()
    rejected = next(one for one in plan["last"] if one["rejection"])
    (answer,) = api.post("/v1/preview", params={"variant": rejected["index"]}, json=spec("n")).json()["variants"]
    assert answer == {"variant": rejected, "picture": None}


@pytest.mark.gl
def test_the_nearest_accepted_variant_is_taken_once(api: httpx.Client) -> None:
    document = spec("n")
    variants = {"variant": [23, 22], "accepted": True}
    (answer,) = api.post("/v1/preview", params=variants, json=document, timeout=120).json()["variants"]
    legal = {one["index"] for one in (api.post("/v1/plan", json=document).json()["first"])}
    assert answer["picture"]
    assert answer["variant"]["rejection"] is None
    assert answer["variant"]["index"] not in legal, "the nearest is not among the first"


@pytest.mark.gl
def test_a_preview_is_the_small_picture_of_its_variant(api: httpx.Client, drawn: DrawnRuns) -> None:
    document = spec("n", width=960, height=540)
    answer = api.post("/v1/preview", params={"variant": [0, 1], "camera": "camera-2"}, json=document, timeout=120)
    assert answer.status_code == 200, answer.text
    pictures = [
        np.asarray(Image.open(io.BytesIO(base64.b64decode(variant["picture"]))))
        for variant in answer.json()["variants"]
    ]
    folder = drawn.folder / "assets"
    manifest, digest = asset_manifest(ASSET, asset_dir=folder)
    resolved = resolve(parse(document), manifest, asset_digest=digest, max_variants=None)
    engine = plugins.create_renderer("raster")
    asset = load_asset(ASSET, asset_dir=folder)
    for index, picture in enumerate(pictures):
        values = resolved.space[index].values
        scene, view = apply(values, asset), View("camera-2", 480, 270)
        exposure = metered_ev(engine.background(scene, view).pixels)
        setting = setting_of(resolved.spec.sensors[0], values, moves=False)
        expected = develop(engine.full(scene, view).pixels, setting, Shot(metered_ev=exposure))
        assert np.array_equal(picture, expected)
    assert not np.array_equal(*pictures)
