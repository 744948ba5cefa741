"""Products go to bytes and come back bit for bit."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray

from valerie.errors import CorruptArtifact
from valerie.rendering.base import GroundTruth, Layer, LinearImage, PersonTruth, Rectangle, TruthLayer
from valerie.storage import codecs, envelope

sides = st.integers(1, 12)


def _same(left: NDArray[Any], right: NDArray[Any]) -> None:
    """Return True if arrays are equal to the bit, with NaN payloads and the sign of zero."""
    assert left.dtype == right.dtype
    assert left.shape == right.shape
    assert left.tobytes() == right.tobytes()


@st.composite
def truths(draw: st.DrawFn) -> GroundTruth:
    shape = (draw(sides), draw(sides))
    ids = sorted(draw(st.sets(st.integers(24_000, 24_999), max_size=3)))
    return GroundTruth(
        class_map=draw(hnp.arrays(np.uint8, shape)),
        instance_map=draw(hnp.arrays(np.uint16, shape)),
        depth=draw(hnp.arrays(np.float32, shape)),
        persons=tuple(PersonTruth.of(i, draw(hnp.arrays(np.bool_, shape)), draw(st.integers(0, 10**9))) for i in ids),
    )


@given(height=sides, width=sides, data=st.data())
def test_an_image_comes_back_bit_for_bit(height: int, width: int, data: st.DataObject) -> None:
    pixels = data.draw(hnp.arrays(np.uint16, (height, width, 3))).view(np.float16)  # every bit pattern, NaN too
    _same(codecs.decode_image(codecs.encode_image(LinearImage(pixels))).pixels, pixels)


@given(box=st.tuples(st.integers(0, 99), st.integers(0, 99), st.integers(0, 9), st.integers(0, 9)), data=st.data())
def test_a_layer_comes_back_bit_for_bit_even_when_it_is_empty(
    box: tuple[int, int, int, int], data: st.DataObject
) -> None:
    rectangle = Rectangle(*box)
    pixels = data.draw(hnp.arrays(np.uint16, (rectangle.height, rectangle.width, 3))).view(np.float16)
    decoded = codecs.decode_layer(codecs.encode_layer(Layer(rectangle, pixels)))
    assert decoded.rectangle == rectangle
    _same(decoded.pixels, pixels)


@given(truth=truths())
@settings(deadline=None)
def test_a_truth_comes_back_bit_for_bit_with_every_mask(truth: GroundTruth) -> None:
    decoded = codecs.decode_truth(codecs.encode_truth(truth))
    for name in ("class_map", "instance_map", "depth"):
        _same(getattr(decoded, name), getattr(truth, name))
    assert [(p.instance_id, p.padded_pixels) for p in decoded.persons] == [
        (p.instance_id, p.padded_pixels) for p in truth.persons
    ]
    for one, other in zip(decoded.persons, truth.persons, strict=True):
        _same(one.amodal, other.amodal)


@st.composite
def truth_layers(draw: st.DrawFn) -> tuple[GroundTruth, TruthLayer]:
    statics = draw(truths())
    height, width = statics.class_map.shape
    x, y = draw(st.integers(0, width - 1)), draw(st.integers(0, height - 1))
    box = Rectangle(x, y, draw(st.integers(0, width - x)), draw(st.integers(0, height - y)))
    changed = draw(hnp.arrays(np.bool_, (box.height, box.width)))
    count = int(changed.sum())
    return statics, TruthLayer(
        box,
        changed,
        draw(hnp.arrays(np.uint8, count)),
        draw(hnp.arrays(np.uint16, count)),
        draw(hnp.arrays(np.uint32, count)).view(np.float32),  # every bit pattern, NaN too
        statics.persons,
        (height, width),
    )


@given(parts=truth_layers())
@settings(deadline=None)
def test_a_stored_layer_over_its_statics_is_the_layer_over_its_statics(parts: tuple[GroundTruth, TruthLayer]) -> None:
    statics, layer = parts
    stored = codecs.decode_stored_truth(codecs.encode_truth_layer(layer, "5f0c3a9be1d24c7788a6e0f1b2c3d4e5"))
    assert isinstance(stored, codecs.StoredTruthLayer)
    assert stored.statics == "5f0c3a9be1d24c7788a6e0f1b2c3d4e5"
    one, other = stored.layer.over(statics), layer.over(statics)
    for name in ("class_map", "instance_map", "depth"):
        _same(getattr(one, name), getattr(other, name))
    for mine, theirs in zip(one.persons, other.persons, strict=True):
        assert (mine.instance_id, mine.padded_pixels) == (theirs.instance_id, theirs.padded_pixels)
        _same(mine.amodal, theirs.amodal)


def test_a_layer_changes_its_pixels_and_no_others() -> None:
    statics = GroundTruth(np.zeros((4, 5), np.uint8), np.zeros((4, 5), np.uint16), np.ones((4, 5), np.float32), ())
    changed = np.array([[True, False], [False, True]])
    layer = TruthLayer(
        Rectangle(2, 1, 2, 2), changed, np.array([24, 26], np.uint8), np.array([24_001, 0], np.uint16),
        np.array([3.0, np.inf], np.float32), (), (4, 5),
    )  # fmt: skip
    whole = layer.over(statics)
    assert whole.class_map.tolist() == [[0] * 5, [0, 0, 24, 0, 0], [0, 0, 0, 26, 0], [0] * 5]
    assert (whole.instance_map[1, 2], whole.instance_map.sum()) == (24_001, 24_001)
    assert (whole.depth[1, 2], whole.depth[2, 3], (whole.depth == 1).sum()) == (3.0, np.inf, 18)
    assert not statics.class_map.any()
    assert not whole.depth.flags.writeable


def test_the_digest_of_statics_follows_from_every_map_and_the_shape() -> None:
    maps = (np.zeros((4, 6), np.uint8), np.zeros((4, 6), np.uint16), np.ones((4, 6), np.float32))
    digests = {codecs.statics_digest(GroundTruth(*maps, ()))}
    for i in range(3):
        other = [array.copy() for array in maps]
        other[i][3, 5] = 7
        digests.add(codecs.statics_digest(GroundTruth(*other, ())))
    digests.add(codecs.statics_digest(GroundTruth(*(array.reshape(6, 4) for array in maps), ())))
    assert len(digests) == 5
    assert codecs.statics_digest(GroundTruth(*maps, ())) in digests


@pytest.mark.parametrize(
    "meta",
    [
        {"rectangle": [4, 1, 2, 2]},  # leaves the image to the right
        {"rectangle": [2, 1, 1, 2]},  # fewer pixels than values
        {"size": [4]},
        {"size": None},
        {"statics": 7},
    ],
)
def test_an_impossible_truth_layer_is_refused(meta: dict[str, object]) -> None:
    given_meta = {"statics": "a", "rectangle": [2, 1, 2, 2], "size": [4, 5], "persons": []} | meta
    arrays = {
        "changed": np.packbits(np.ones((2, 2), np.bool_)),
        "classes": np.zeros(4, np.uint8),
        "instances": np.zeros(4, np.uint16),
        "depths": np.zeros(4, np.float32),
    }
    with pytest.raises(CorruptArtifact):
        codecs.decode_stored_truth(envelope.pack("truth-layer", arrays, given_meta))


def test_the_depth_of_the_sky_stays_infinite() -> None:
    shape = (2, 3)
    truth = GroundTruth(
        np.full(shape, 23, np.uint8), np.zeros(shape, np.uint16), np.full(shape, np.inf, np.float32), persons=()
    )
    assert np.isposinf(codecs.decode_truth(codecs.encode_truth(truth)).depth).all()


def test_decoded_truth_is_read_only() -> None:
    shape = (2, 3)
    person = PersonTruth.of(24_001, np.ones(shape, np.bool_), 6)
    truth = GroundTruth(np.zeros(shape, np.uint8), np.zeros(shape, np.uint16), np.ones(shape, np.float32), (person,))
    decoded = codecs.decode_truth(codecs.encode_truth(truth))
    arrays = (decoded.class_map, decoded.instance_map, decoded.depth, decoded.persons[0].amodal)
    assert not any(array.flags.writeable for array in arrays)


def test_a_person_costs_what_its_box_needs_not_what_the_image_needs() -> None:
    shape = (1000, 1000)
    noise = np.random.default_rng(0).random((40, 20)) < 0.5  # incompressible: 800 bits
    mask = np.zeros(shape, np.bool_)
    mask[500:540, 300:320] = noise
    bare = GroundTruth(np.zeros(shape, np.uint8), np.zeros(shape, np.uint16), np.ones(shape, np.float32), ())
    with_person = GroundTruth(bare.class_map, bare.instance_map, bare.depth, (PersonTruth.of(24_001, mask, 400),))
    # 100 bytes of mask, and its name, type, place and box as text; a mask of the image has 125,000.
    assert len(codecs.encode_truth(with_person)) - len(codecs.encode_truth(bare)) < 300


@given(train_ids=hnp.arrays(np.uint8, hnp.array_shapes(min_dims=2, max_dims=2, max_side=12)))
def test_a_prediction_comes_back(train_ids: NDArray[np.uint8]) -> None:
    _same(codecs.decode_prediction(codecs.encode_prediction(train_ids)), train_ids)


@given(counts=hnp.arrays(np.int64, (19, 20)))
def test_counts_come_back(counts: NDArray[np.int64]) -> None:
    _same(codecs.decode_counts(codecs.encode_counts(counts)), counts)


@pytest.mark.parametrize(
    "meta",
    [
        {"rectangle": [0, 0, 3, 2]},  # width and height exchanged
        {"rectangle": [0, 0, 2]},
        {"rectangle": [-1, 0, 2, 3]},
        {"rectangle": [0, 0, 1 << 40, 1 << 40]},
        {"rectangle": None},
        {},
    ],
)
def test_a_layer_whose_rectangle_does_not_fit_its_pixels_is_refused(meta: dict[str, object]) -> None:
    data = envelope.pack("layer", {"planes": np.zeros((2, 3, 2, 3), np.uint8)}, meta)
    with pytest.raises(CorruptArtifact):
        codecs.decode_layer(data)


def test_an_image_of_another_type_is_refused_with_what_was_expected() -> None:
    data = envelope.pack("image", {"planes": np.zeros((3, 2, 3), np.float32)}, {})
    with pytest.raises(CorruptArtifact, match=r"float32 \(3, 2, 3\), expected uint8"):
        codecs.decode_image(data)


def test_images_and_layers_of_release_0_1_0_are_read() -> None:
    pixels = np.arange(18, dtype=np.float16).reshape(3, 2, 3)
    image = envelope.pack("image", {"pixels": pixels}, {})
    layer = envelope.pack("layer", {"pixels": pixels}, {"rectangle": [5, 4, 2, 3]})
    np.testing.assert_array_equal(codecs.decode_image(image).pixels, pixels)
    np.testing.assert_array_equal(codecs.decode_layer(layer).pixels, pixels)


def _truth_data(**changes: object) -> bytes:
    arrays = {
        "class_map": np.zeros((4, 5), np.uint8),
        "instance_map": np.zeros((4, 5), np.uint16),
        "depth": np.ones((4, 5), np.float32),
        "amodal.24001": np.packbits(np.ones((2, 3), np.bool_)),
    }
    meta: dict[str, object] = {"persons": [[24_001, 6, 1, 1, 3, 2]]}
    for name, value in changes.items():
        if isinstance(value, np.ndarray):
            arrays[name] = value
        else:
            meta[name] = value
    return envelope.pack("truth", arrays, meta)


def test_the_unchanged_truth_of_these_tests_is_accepted() -> None:
    mask = codecs.decode_truth(_truth_data()).persons[0].amodal
    assert mask.sum() == 6
    assert mask[1:3, 1:4].all()


@pytest.mark.parametrize(
    "persons",
    [
        [[24_001, 6, 3, 1, 3, 2]],  # leaves the image to the right
        [[24_001, 6, 1, 3, 3, 2]],  # leaves it below
        [[24_001, 6, 1, 1, 9, 9]],
        [[24_001, 6, 1, 1, -3, -2]],
        [[24_002, 6, 1, 1, 3, 2]],  # no mask of that name
        [[24_001, 6, 1, 1, 3, 2], [24_001, 6, 1, 1, 3, 2]],
        [[24_001, 6]],
        ["24001"],
        None,
    ],
)
def test_a_truth_with_impossible_persons_is_refused(persons: object) -> None:
    with pytest.raises(CorruptArtifact):
        codecs.decode_truth(_truth_data(persons=persons))


def test_a_truth_whose_maps_differ_in_size_is_refused() -> None:
    with pytest.raises(CorruptArtifact, match="depth"):
        codecs.decode_truth(_truth_data(depth=np.ones((5, 4), np.float32)))
