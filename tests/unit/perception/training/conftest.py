from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("torch")

from valerie.perception.training.frame_folder import TrainingFrame


def _frame(number: int, street_seed: int, height: int, width: int) -> TrainingFrame:
    """Road below, sky above, and a yellow box that is a person, at a place of its own in each frame."""
    rng = np.random.default_rng([street_seed, number])
    labels = np.full((height, width), 10, np.uint8)
    labels[height // 2 :] = 0
    top, left = int(rng.integers(height // 2)), int(rng.integers(width - width // 4))
    labels[top : top + height // 2, left : left + width // 4] = 11
    colours = {10: (120, 160, 220), 0: (90, 90, 95), 11: (220, 200, 40)}
    picture = np.zeros((height, width, 3), np.uint8)
    for train_id, colour in colours.items():
        picture[labels == train_id] = colour
    noise = rng.integers(-15, 16, picture.shape)
    return TrainingFrame((picture + noise).clip(0, 255).astype(np.uint8), labels, street_seed)


@pytest.fixture
def make_frames():
    """``make_frames(n, street_seed=1000, height=64, width=96)``: a list of synthetic frames."""

    def make(count: int, *, street_seed: int = 1000, height: int = 64, width: int = 96) -> list[TrainingFrame]:
        return [_frame(number, street_seed, height, width) for number in range(count)]

    return make
