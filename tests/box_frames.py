"""Small synthetic training frames: road below, sky above, and a yellow box that is a person."""

from __future__ import annotations

import numpy as np

from valerie.perception.training.frame_folder import TrainingFrame

_SKY, _ROAD, _PERSON = 10, 0, 11
_COLOURS = {_SKY: (120, 160, 220), _ROAD: (90, 90, 95), _PERSON: (220, 200, 40)}


def box_frames(count: int, *, street_seed: int = 1000, height: int = 64, width: int = 96) -> list[TrainingFrame]:
    """Return frames of one street; the box has a place of its own in each."""
    return [_frame(number, street_seed, height, width) for number in range(count)]


def _frame(number: int, street_seed: int, height: int, width: int) -> TrainingFrame:
    rng = np.random.default_rng([street_seed, number])
    labels = np.full((height, width), _SKY, np.uint8)
    labels[height // 2 :] = _ROAD
    top, left = int(rng.integers(height // 2)), int(rng.integers(width - width // 4))
    labels[top : top + height // 2, left : left + width // 4] = _PERSON
    picture = np.zeros((height, width, 3), np.uint8)
    for train_id, colour in _COLOURS.items():
        picture[labels == train_id] = colour
    noise = rng.integers(-15, 16, picture.shape)
    return TrainingFrame((picture + noise).clip(0, 255).astype(np.uint8), labels, street_seed)
