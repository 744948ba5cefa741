"""The shipped networks see what they are said to see: measured on sites that they were not trained on."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np
import pytest
from numpy.typing import NDArray

from valerie.labels import PERSON, to_train_ids
from valerie.metrics.aggregate import pooled
from valerie.metrics.confusion import confusion_matrix
from valerie.metrics.matrix import ConfusionMatrix
from valerie.metrics.scores import frame_scores
from valerie.perception.base import PerceptionFunction
from valerie.perception.shipped import FUNCTIONS, function_card, load_function
from valerie.perception.training.provenance import sites_seen
from valerie.pipeline.retraining import training_scenes
from valerie.pipeline.retraining.crowds import crowd_asset
from valerie.pipeline.retraining.training_scenes import draw_scene
from valerie.rendering.base import View
from valerie.scene.assets.asset import load_asset
from valerie.sensing.sensor import develop

pytestmark = [pytest.mark.gl, pytest.mark.timeout(1200)]

SITES = (900, 901)
#: Cameras with their light, and frames behind each: these share a background, which costs more than all else, but no person.
SETTINGS_PER_STREET = 2
FRAMES_PER_SETTING = 3
SIZE = (960, 540)
TRAINED_ON = range(1000, 100_000)


@dataclass(frozen=True)
class Pair:
    """A held-out frame with its people, and the same frame without them."""

    picture: NDArray[np.uint8]
    empty_picture: NDArray[np.uint8]
    truth: NDArray[np.uint8]


def render_pairs() -> Iterator[Pair]:
    from valerie.rendering.ground_truth import TruthPass
    from valerie.rendering.raster.renderer import RasterRenderer
    from valerie.rendering.raster.upload.context import process_context

    context = process_context()
    renderer, truth_pass = RasterRenderer(context), TruthPass(context)
    for site in SITES:
        crowd = crowd_asset(load_asset({"name": "urban-street", "seed": site}))
        for setting, number in product(range(SETTINGS_PER_STREET), range(FRAMES_PER_SETTING)):
            seed = [training_scenes.REVISION, site, setting]
            drawn = draw_scene(
                crowd,
                np.random.default_rng([*seed, 1 + number]),
                setting=np.random.default_rng([*seed, 0]),
                people_only=True,
            )
            view = View(drawn.camera, *SIZE)
            # Movables that nobody asked for are hidden, so the background is the frame without its people.
            shown = [n for n in drawn.scene.nodes.values() if n.movable and n.visible and n.meshes]
            assert all(n.label_id == PERSON.id for n in shown)
            background = renderer.background(drawn.scene, view)
            whole = renderer.layer(drawn.scene, view).over(background)
            yield Pair(
                develop(whole.pixels, drawn.sensor),
                develop(background.pixels, drawn.sensor),
                to_train_ids(truth_pass.truth(drawn.scene, view).class_map),
            )
    truth_pass.close()
    renderer.close()


@pytest.fixture(scope="module")
def pairs() -> list[Pair]:
    rendered = list(render_pairs())
    with_people = [pair for pair in rendered if (pair.truth == PERSON.train_id).any()]
    assert len(with_people) >= len(rendered) / 2
    assert len(with_people) < len(rendered), "some held-out frames show nobody"
    return rendered


@pytest.fixture(scope="module", params=FUNCTIONS)
def seen(request: pytest.FixtureRequest, pairs: list[Pair]) -> list[tuple[Pair, NDArray[np.uint8], NDArray[np.uint8]]]:
    """Per pair: the function's labels with and without people."""
    function: PerceptionFunction = load_function(request.param, threads=1)
    predicted = [(pair, function.predict(pair.picture), function.predict(pair.empty_picture)) for pair in pairs]
    function.close()
    return predicted


def test_pooled_person_iou_is_at_least_forty_percent(seen: list[tuple[Pair, np.ndarray, np.ndarray]]) -> None:
    matrices: list[ConfusionMatrix] = [confusion_matrix(pair.truth, labels) for pair, labels, _ in seen]
    iou = frame_scores(pooled(matrices)).iou
    assert iou is not None
    assert iou >= 0.4


def test_removing_the_people_removes_what_was_seen_inside_their_masks(
    seen: list[tuple[Pair, np.ndarray, np.ndarray]],
) -> None:
    before = after = 0
    for pair, with_people, empty in seen:
        mask = pair.truth == PERSON.train_id
        before += int((with_people[mask] == PERSON.train_id).sum())
        after += int((empty[mask] == PERSON.train_id).sum())
    assert before > 0
    assert after <= 0.1 * before


@pytest.mark.parametrize("name", FUNCTIONS)
def test_the_header_says_what_was_held_out_and_what_goes_wrong(name: str) -> None:
    provenance = function_card(name).provenance
    seeds_seen = {seed for seeds in sites_seen(provenance) for seed in seeds}
    assert seeds_seen
    assert seeds_seen <= set(TRAINED_ON)
    assert seeds_seen.isdisjoint(SITES)
    assert 0.0 < float(provenance["held-out-person-iou"]) < 1.0
    assert provenance["known-weaknesses"]
    assert provenance["licence"] == "Apache-2.0"
