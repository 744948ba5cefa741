"""The loss of a training step."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

from valerie.labels import NUM_TRAIN_CLASSES, PERSON, VOID


def pixel_loss(logits: Tensor, labels: Tensor, class_weights: Tensor, *, void_weight: float = 0.0) -> Tensor:
    """Return the weighted mean over pixels: cross-entropy of labelled ones, −log(1 − p(person)) of void ones.

    Void pixels of our frames (a waste bin, a bench) have no class to learn, but they are not persons. The second term is the
    negative log-likelihood of that complementary label (negative learning: Kim et al., NLNL, ICCV 2019).

    Args:
        logits: (B, 19, H, W) fp32.
        labels: (B, H, W) int64 train ids, 0…18 or 255.
        class_weights: (19,) weights of a pixel by class.
        void_weight: weight of a void pixel; 0 leaves them out.

    Returns:
        Scalar; 0 if nothing has weight.
    """
    sums = functional.cross_entropy(logits, labels, class_weights, ignore_index=VOID, reduction="sum")
    counts = torch.bincount(labels.flatten(), minlength=VOID + 1)
    weight = (counts[:NUM_TRAIN_CLASSES] * class_weights).sum()
    if void_weight > 0.0:
        void = logits.permute(0, 2, 3, 1)[labels == VOID]
        others = torch.cat((void[:, : PERSON.train_id], void[:, PERSON.train_id + 1 :]), dim=1)
        # −log(1 − p) from the margin of the person's logit, since 1 − p becomes 0 in fp32 for a confident network.
        margin = void[:, PERSON.train_id] - others.logsumexp(dim=1)
        sums = sums + void_weight * functional.softplus(margin).sum()
        weight = weight + void_weight * counts[VOID]
    # reduction="mean" would be NaN for a batch of void pixels only.
    return sums / weight.clamp(min=1.0)
