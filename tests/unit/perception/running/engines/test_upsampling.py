"""Labels from coarse logits; torch interpolates all of them as the oracle."""

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from torch.nn import functional

from valerie.perception.running.adaptation import Size
from valerie.perception.running.engines.upsampling import upsampled_ids


def regions(channels: int, height: int, width: int, *, seed: int = 0) -> NDArray[np.float32]:
    """Logits of blobs with noise: whole regions of one class, and borders."""
    random = np.random.default_rng(seed)
    coarse = torch.from_numpy(random.normal(0, 5, (1, channels, 4, 6)).astype(np.float32))
    blobs = functional.interpolate(coarse, size=(height, width), mode="bicubic")[0].numpy()
    return (blobs + random.normal(0, 0.3, blobs.shape)).astype(np.float32)


def interpolated(logits: NDArray[np.float32], size: tuple[int, int], *, align_corners: bool) -> torch.Tensor:
    values = torch.from_numpy(logits)[None].double()
    return functional.interpolate(values, size=size, mode="bilinear", align_corners=align_corners)[0]


@pytest.mark.parametrize("align_corners", [False, True])
@pytest.mark.parametrize("size", [(136, 240), (162, 288), (31, 61), (100, 7), (34, 60), (1, 1), (20, 30)])
@pytest.mark.parametrize("channels", [2, 19, 150])
def test_labels_are_those_of_interpolating_every_logit(
    channels: int, size: tuple[int, int], align_corners: bool
) -> None:
    logits = regions(channels, 34, 60)
    whole = interpolated(logits, size, align_corners=align_corners)
    ids = upsampled_ids(logits, Size(*size), align_corners=align_corners)
    assert ids.shape == size
    assert ids.dtype == np.uint8
    # Where two classes are equal but for rounding, either is right.
    best, second = whole.topk(2, dim=0).values
    clear = ((best - second) > 1e-5).numpy()
    np.testing.assert_array_equal(ids[clear], whole.argmax(0).numpy()[clear])
    assert clear.mean() > 0.999  # or little would be compared


def test_a_class_that_is_second_everywhere_wins_between_two_others() -> None:
    logits = np.array([[[10.0, 0.0]], [[0.0, 10.0]], [[7.0, 7.0]]], np.float32)
    assert upsampled_ids(logits, Size(1, 5), align_corners=True).tolist() == [[0, 0, 2, 1, 1]]


def test_of_equal_logits_the_smaller_class_wins() -> None:
    logits = np.zeros((5, 3, 4), np.float32)
    logits[3, :, 2:] = 1.0
    assert set(upsampled_ids(logits, Size(12, 16))[:, :4].ravel().tolist()) == {0}
    assert set(upsampled_ids(logits, Size(12, 16))[:, 12:].ravel().tolist()) == {3}


def test_the_logits_stay_as_they_are() -> None:
    logits = regions(19, 17, 30)
    before = logits.copy()
    upsampled_ids(logits, Size(68, 120))
    np.testing.assert_array_equal(logits, before)
