import numpy as np
import pytest

from valerie.perception.training.frame_folder import TrainingFrame
from valerie.perception.training.statistics import class_weights


def frames(**counts: int) -> list[TrainingFrame]:
    """One frame of 20 × 20 blocks of 2 × 2 pixels with so many blocks of each train id, the rest void."""
    blocks = np.full(400, 255, np.uint8)
    ids = [train_id for train_id, count in counts.items() for _ in range(count)]
    blocks[: len(ids)] = [int(train_id.removeprefix("c")) for train_id in ids]
    labels = blocks.reshape(20, 20).repeat(2, axis=0).repeat(2, axis=1)
    return [TrainingFrame(np.zeros((40, 40, 3), np.uint8), labels, 1000)]


def test_without_balance_every_class_weighs_one() -> None:
    np.testing.assert_array_equal(class_weights(frames(c0=300, c11=20), 0.0), np.ones(19))


def test_with_full_balance_every_class_weighs_the_same_in_all() -> None:
    weights = class_weights(frames(c0=160, c2=80, c11=40), 1.0)
    assert 160 * weights[0] == pytest.approx(80 * weights[2]) == pytest.approx(40 * weights[11])


def test_a_class_a_sixteenth_as_frequent_weighs_twice_as_much_at_a_quarter() -> None:
    weights = class_weights(frames(c0=320, c11=20), 0.25)
    assert weights[11] / weights[0] == pytest.approx(2.0)


def test_the_average_labelled_pixel_weighs_one() -> None:
    weights = class_weights(frames(c0=300, c5=60, c11=20), 0.5)
    assert (300 * weights[0] + 60 * weights[5] + 20 * weights[11]) / 380 == pytest.approx(1.0, rel=1e-6)


def test_a_class_that_is_not_seen_weighs_as_the_rarest() -> None:
    weights = class_weights(frames(c0=300, c11=10), 0.5)
    assert weights[17] == weights[11]


def test_no_class_makes_the_loss_leap() -> None:
    assert class_weights(frames(c0=399, c17=1), 1.0).max() == 12.0


def test_frames_that_are_void_throughout_weigh_alike() -> None:
    np.testing.assert_array_equal(class_weights(frames(), 0.5), np.ones(19))
