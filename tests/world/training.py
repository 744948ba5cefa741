"""The loop back to training without an engine: training frames that are drawn, and what a drawn run is compared in."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from valerie.labels import PERSON, VOID
from valerie.perception.shipped import load_function
from valerie.perception.training.frame_folder import FrameFolder, Shard, TrainingFrame, write_index, write_shard
from valerie.pipeline.retraining.training_frames import FrameSettings
from valerie.settings import Settings

#: Scenes that drawing one frame of a region is said to have taken.
DRAWS = 3
_ROAD, _SKY = 0, 10


def draw_frames(
    folder: Path,
    settings: FrameSettings,
    *,
    processes: int = 1,
    progress: Callable[[Shard], None] = lambda _: None,
) -> FrameFolder:
    """Stand in for `training_frames.render_frames`: sky, road and a yellow box as a person."""
    folder.mkdir(parents=True)
    shards = []
    for seed in settings.seeds():
        shard = write_shard(folder, seed, [_frame(settings, seed, number) for number in range(settings.per_street)])
        if settings.region is not None:
            shard = shard.model_copy(update={"drawn": DRAWS * settings.per_street})
        shards.append(shard)
        progress(shard)
    seeds = settings.seeds()
    write_index(folder, shards, {"asset": settings.asset, "street-seeds": f"{seeds[0]}-{seeds[-1]}"})
    return FrameFolder(folder)


def class_here(function: str, settings: Settings) -> str:
    """The numeric class in which a function that ships with VALERIE runs in this process."""
    opened = load_function(function, threads=settings.inference_threads, device=settings.infer_device)
    try:
        return opened.numeric_class
    finally:
        opened.close()


def _frame(settings: FrameSettings, seed: int, number: int) -> TrainingFrame:
    rng = np.random.default_rng([seed, number, settings.region is not None])
    height, width = settings.height, settings.width
    labels = np.full((height, width), _SKY, np.uint8)
    labels[height // 2 :] = _ROAD
    labels[0] = VOID
    top, left = int(rng.integers(1, height // 2)), int(rng.integers(width - width // 8))
    labels[top : top + height // 2, left : left + width // 8] = PERSON.train_id
    picture = np.zeros((height, width, 3), np.uint8)
    for train_id, colour in ((_SKY, (120, 160, 220)), (_ROAD, (90, 90, 95)), (PERSON.train_id, (220, 200, 40))):
        picture[labels == train_id] = colour
    noisy = picture + rng.integers(-15, 16, picture.shape)
    return TrainingFrame(noisy.clip(0, 255).astype(np.uint8), labels, seed)
