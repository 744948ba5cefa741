import math

import numpy as np
import pytest
import torch
from sklearn.metrics import log_loss

from valerie.labels import PERSON, VOID
from valerie.perception.training.loss import pixel_loss


def logits(*shape: int, seed: int = 5) -> torch.Tensor:
    return torch.from_numpy(np.random.default_rng(seed).normal(0.0, 3.0, (shape[0], 19, *shape[1:]))).float()


def in_rows(of: torch.Tensor) -> np.ndarray:
    return of.double().softmax(dim=1).permute(0, 2, 3, 1).reshape(-1, 19).numpy()


def test_labelled_pixels_cost_scikit_learns_weighted_cross_entropy() -> None:
    given, labels = logits(2, 5, 7), torch.arange(70).reshape(2, 5, 7) % 19
    weights = torch.linspace(0.5, 2.0, 19)
    expected = log_loss(
        labels.flatten(), in_rows(given), sample_weight=weights[labels.flatten()].numpy(), labels=list(range(19))
    )
    assert pixel_loss(given, labels, weights).item() == pytest.approx(expected, rel=1e-4)


def test_void_pixels_cost_nothing_by_default() -> None:
    given, labels = logits(1, 4, 4), torch.full((1, 4, 4), 3)
    labels[0, 2:] = VOID
    alone = pixel_loss(given[:, :, :2], labels[:, :2], torch.ones(19))
    assert pixel_loss(given, labels, torch.ones(19)).item() == pytest.approx(alone.item(), rel=1e-6)


def test_void_pixels_cost_the_cross_entropy_of_person_or_not() -> None:
    given, labels = logits(1, 6, 6), torch.full((1, 6, 6), VOID)
    person = in_rows(given)[:, PERSON.train_id]
    expected = log_loss(np.zeros(36), person, labels=[0, 1])
    assert pixel_loss(given, labels, torch.ones(19), void_weight=0.5).item() == pytest.approx(expected, rel=1e-4)


def test_void_pixels_count_by_their_weight_beside_the_others() -> None:
    given, labels = logits(1, 1, 4), torch.tensor([[[8, VOID, VOID, VOID]]])
    labelled = pixel_loss(given[..., :1], labels[..., :1], torch.full((19,), 2.0)).item()
    void = pixel_loss(given[..., 1:], labels[..., 1:], torch.ones(19), void_weight=1.0).item()
    together = pixel_loss(given, labels, torch.full((19,), 2.0), void_weight=0.5).item()
    assert together == pytest.approx((2.0 * labelled + 1.5 * void) / 3.5, rel=1e-5)


def test_a_sure_person_on_void_costs_much_and_pushes_the_person_down() -> None:
    scores = torch.zeros((1, 19, 1, 1))
    scores[:, PERSON.train_id] = 40.0
    scores.requires_grad_()
    loss = pixel_loss(scores, torch.full((1, 1, 1), VOID), torch.ones(19), void_weight=1.0)
    torch.autograd.backward(loss)
    assert loss.item() == pytest.approx(40.0 - math.log(18.0), rel=1e-5)
    assert scores.grad is not None
    assert scores.grad[0, PERSON.train_id, 0, 0].item() == pytest.approx(1.0, abs=1e-5)


def test_a_batch_that_is_void_throughout_costs_nothing_and_is_finite() -> None:
    assert pixel_loss(logits(1, 3, 3), torch.full((1, 3, 3), VOID), torch.ones(19)).item() == 0.0
