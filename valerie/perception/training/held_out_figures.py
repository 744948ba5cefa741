"""Validation figures of a network on held-out frames, from pooled counts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn

from valerie.labels import NUM_TRAIN_CLASSES, PERSON
from valerie.perception.documents.function import InputDocument
from valerie.perception.running.adaptation import plan
from valerie.perception.running.engines.labelling import ALIGNMENT, label_maps
from valerie.perception.training.frame_folder import TrainingFrame


@dataclass(frozen=True, slots=True)
class ValidationFigures:
    """Ratios in [0, 1] of counts that are pooled over all frames; undefined ones are None.

    Attributes:
        frames: number of frames.
        person_pacc: recall of the person class.
        person_precision, person_iou: precision and IoU of the person class.
        miou: mean IoU of the classes in the truth.
    """

    frames: int
    person_pacc: float | None
    person_precision: float | None
    person_iou: float | None
    miou: float | None

    def as_text(self) -> dict[str, str]:
        """Return header entries ``held-out-…`` with four decimals, or ``undefined``."""
        ratios = {
            "person-iou": self.person_iou,
            "person-pacc": self.person_pacc,
            "person-precision": self.person_precision,
            "miou": self.miou,
        }
        entries = {f"held-out-{name}": "undefined" if x is None else f"{x:.4f}" for name, x in ratios.items()}
        return {"held-out-frames": str(self.frames), **entries}


def validate(
    network: nn.Module,
    frames: Sequence[TrainingFrame],
    mean: Tensor,
    std: Tensor,
    *,
    longest_side: int | None = None,
) -> ValidationFigures:
    """Return the figures of a network on whole frames.

    The network predicts exactly as in `valerie.perception.running.engines.torch_engine`, on its device in fp32. Its mode
    (training or evaluation) is restored.

    Args:
        network: network to validate.
        frames: frames with their labels.
        mean, std: (3,) float32 on the network's device.
        longest_side: pixels; longer frames are reduced to it, as the function will do (`InputDocument`).
    """
    document = InputDocument(multiple_of=ALIGNMENT, longest_side=longest_side)
    n = NUM_TRAIN_CLASSES
    counts = np.zeros((n, n), np.int64)
    training = network.training
    network.eval()
    with torch.inference_mode():
        for frame in frames:
            steps = plan(document, *frame.train_ids.shape)
            (piece,) = steps.pieces(frame.picture)
            picture = torch.from_numpy(piece.copy()).unsqueeze(0).to(mean.device)
            predicted = steps.joined([label_maps(network, picture, mean, std, labels=steps.labels)[0].cpu().numpy()])
            labelled = frame.train_ids < n
            pairs = frame.train_ids[labelled].astype(np.int64) * n + predicted[labelled]
            counts += np.bincount(pairs, minlength=n * n).reshape(n, n)
    network.train(training)
    return _figures(counts, len(frames))


def _figures(counts: np.ndarray[tuple[int, int], np.dtype[np.int64]], frames: int) -> ValidationFigures:
    tp, truth, predicted = np.diagonal(counts), counts.sum(axis=1), counts.sum(axis=0)
    union = truth + predicted - tp
    present = truth > 0
    person = PERSON.train_id

    def ratio(whole: int) -> float | None:
        return int(tp[person]) / whole if whole else None

    return ValidationFigures(
        frames=frames,
        person_pacc=ratio(int(truth[person])),
        person_precision=ratio(int(predicted[person])),
        person_iou=ratio(int(union[person])),
        miou=float(np.mean(tp[present] / union[present])) if present.any() else None,
    )
