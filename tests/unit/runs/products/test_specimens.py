"""When two numeric classes agree."""

from __future__ import annotations

import numpy as np
import pytest

from valerie.perception.base import FunctionCard
from valerie.runs.products.pins import BOUNDS, TRUTH, FunctionOffer, Offer
from valerie.runs.products.specimens import agree, of_image, of_labels, of_truth, specimen_key
from valerie.runs.products.states import Stage

#: 10,000 pixels: one of them is 0.01 %.
SIZE = (100, 100)


def rendering(numeric_class: str, name: str = "raster", revision: int = 1) -> Offer:
    return Offer(
        stage=Stage.RENDER, name=name, numeric_class=numeric_class, revision=revision, route=f"render.{numeric_class}"
    )


def function(numeric_class: str, weights: str = "aa") -> FunctionOffer:
    return FunctionOffer(
        stage=Stage.INFER, name="f", numeric_class=numeric_class, revision=1, route=f"infer.{numeric_class}",
        digest=weights, card=FunctionCard("f", weights, "", "", "", {}),
    )  # fmt: skip


def agreed(one: Offer, other: Offer, mine: bytes | None, theirs: bytes | None) -> bool:
    stored = {specimen_key(one): mine, specimen_key(other): theirs}
    return agree(one, other, {key: data for key, data in stored.items() if data is not None}, BOUNDS)


def image(changed: int, by: float) -> bytes:
    """Return a specimen of an image of which so many of the 30,000 values are brighter by so many grey levels."""
    grey = np.full((*SIZE, 3), 100.0)
    grey.reshape(-1)[:changed] += by
    share = (grey / 255.0) ** 2
    return of_image((share / (1.0 - share)).astype(np.float16))


@pytest.mark.parametrize(
    ("changed", "by", "expected"), [(0, 0, True), (30_000, 1, True), (30, 9, True), (31, 9, False), (31, 2, False)]
)
def test_images_agree_if_999_of_1000_values_are_within_a_grey_level(changed: int, by: float, expected: bool) -> None:
    assert agreed(rendering("a"), rendering("b"), image(0, 0), image(changed, by)) is expected
    assert agreed(rendering("b"), rendering("a"), image(changed, by), image(0, 0)) is expected


@pytest.mark.parametrize(("changed", "expected"), [(10, True), (11, False)])
@pytest.mark.parametrize("what", ["label", "instance"])
def test_truths_agree_if_999_of_1000_pixels_are_equal(changed: int, what: str, expected: bool) -> None:
    labels, instances = np.full(SIZE, 24, np.uint8), np.zeros(SIZE, np.uint16)
    instances[:50] = 24_001
    mine = of_truth(labels, instances)
    if what == "label":
        labels.reshape(-1)[-changed:] = 7
    else:
        instances.reshape(-1)[:changed] = 24_002
    assert agreed(rendering("a", TRUTH), rendering("b", TRUTH), mine, of_truth(labels, instances)) is expected


@pytest.mark.parametrize(("changed", "expected"), [(50, True), (51, False)])
def test_functions_agree_if_995_of_1000_labels_are_equal(changed: int, expected: bool) -> None:
    labels = np.zeros(SIZE, np.uint8)
    mine = of_labels(labels)
    labels.reshape(-1)[:changed] = 1
    assert agreed(function("a"), function("b"), mine, of_labels(labels)) is expected


def test_a_class_agrees_with_itself_without_specimens() -> None:
    assert agreed(rendering("a"), rendering("a"), None, None)


def test_another_class_without_a_specimen_does_not_agree() -> None:
    assert not agreed(rendering("a"), rendering("b"), image(0, 0), None)


def test_other_revisions_and_other_weights_never_agree() -> None:
    labels = of_labels(np.zeros(SIZE, np.uint8))
    assert not agreed(rendering("a"), rendering("a", revision=2), image(0, 0), image(0, 0))
    assert not agreed(function("a"), function("a", weights="bb"), labels, labels)


def test_pictures_of_other_sizes_do_not_agree() -> None:
    small = of_labels(np.zeros((10, 10), np.uint8))
    assert not agreed(function("a"), function("b"), of_labels(np.zeros(SIZE, np.uint8)), small)
