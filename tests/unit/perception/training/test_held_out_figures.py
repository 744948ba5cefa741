import numpy as np
import pytest
import torch
from torch import Tensor, nn

from valerie.metrics.aggregate import pooled
from valerie.metrics.confusion import confusion_matrix
from valerie.metrics.scores import frame_scores
from valerie.perception.training.frame_folder import TrainingFrame
from valerie.perception.training.held_out_figures import validate

MEAN, STD = torch.zeros(3), torch.ones(3)


class ByRed(nn.Module):
    """Reads the train id from the red channel, which the test paints in 4 × 4 cells."""

    def forward(self, x: Tensor) -> Tensor:
        ids = (nn.functional.avg_pool2d(x[:, 0], 4) * 255).round().long().clamp(0, 18)
        return nn.functional.one_hot(ids, 19).permute(0, 3, 1, 2).float()


def frame_of(predicted: np.ndarray, truth: np.ndarray) -> TrainingFrame:
    picture = np.zeros((*truth.shape, 3), np.uint8)
    picture[..., 0] = predicted
    return TrainingFrame(picture, truth, 900)


def test_the_figures_are_those_of_the_pooled_confusion_matrix() -> None:
    rng = np.random.default_rng(0)
    frames, matrices = [], []
    for _ in range(3):
        predicted = rng.choice([0, 8, 11], (1, 3)).repeat(64, axis=0).repeat(32, axis=1).astype(np.uint8)
        truth = np.where(rng.random((64, 96)) < 0.7, predicted, rng.choice([0, 8, 11, 255], (64, 96))).astype(np.uint8)
        frames.append(frame_of(predicted, truth))
        matrices.append(confusion_matrix(truth, predicted))
    oracle = frame_scores(pooled(matrices))
    figures = validate(ByRed(), frames, MEAN, STD)
    assert figures.frames == 3
    # Stripes as wide as multiples of the stride have their borders between pixels, and no corners, where classes mix.
    assert figures.person_pacc == pytest.approx(oracle.pacc)
    assert figures.person_precision == pytest.approx(oracle.precision)
    assert figures.person_iou == pytest.approx(oracle.iou)
    assert figures.miou == pytest.approx(oracle.miou)


def test_without_a_person_the_figures_are_undefined() -> None:
    nothing = np.zeros((32, 32), np.uint8)
    figures = validate(ByRed(), [frame_of(nothing, nothing)], MEAN, STD)
    assert figures.person_pacc is None
    assert figures.miou == 1.0
    assert figures.as_text()["held-out-person-iou"] == "undefined"


def test_a_network_in_training_stays_in_training() -> None:
    network = ByRed().train()
    nothing = np.zeros((32, 32), np.uint8)
    validate(network, [frame_of(nothing, nothing)], MEAN, STD)
    assert network.training
