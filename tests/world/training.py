"""Training frames without an engine: drawn, small, and quick to learn from."""

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
_COLOURS = {_SKY: (120, 160, 220), _ROAD: (90, 90, 95), PERSON.train_id: (220, 200, 40)}


def draw_frames(
    folder: Path,
    settings: FrameSettings,
    *,
    processes: int = 1,
    progress: Callable[[Shard], None] = lambda _: None,
) -> FrameFolder:
    """Stand in for `training_frames.render_training_frames` with `box_frames`."""
    folder.mkdir(parents=True)
    shards = []
    for seed in settings.seeds():
        size = {"height": settings.height, "width": settings.width}
        frames = box_frames(settings.per_site, site_seed=seed, kind=int(settings.region is not None), **size)
        shard = write_shard(folder, seed, frames)
        if settings.region is not None:
            shard = shard.model_copy(update={"drawn": DRAWS * settings.per_site})
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


def box_frames(
    count: int, *, site_seed: int = 1000, height: int = 64, width: int = 96, kind: int = 0
) -> list[TrainingFrame]:
    """Draw frames of one site: sky, road, a yellow box that is a person, and a row of void.

    Args:
        count: number of frames; the box has a place of its own in each.
        site_seed: of the site.
        height: of a frame, in pixels.
        width: of a frame, in pixels.
        kind: equal sites of another kind show the box elsewhere.
    """
    return [_frame(np.random.default_rng([site_seed, n, kind]), site_seed, height, width) for n in range(count)]


def _frame(rng: np.random.Generator, site_seed: int, height: int, width: int) -> TrainingFrame:
    labels = np.full((height, width), _SKY, np.uint8)
    labels[height // 2 :] = _ROAD
    labels[0] = VOID
    top, left = int(rng.integers(1, height // 2)), int(rng.integers(width - width // 4))
    labels[top : top + height // 2, left : left + width // 4] = PERSON.train_id
    picture = np.zeros((height, width, 3), np.uint8)
    for train_id, colour in _COLOURS.items():
        picture[labels == train_id] = colour
    noise = rng.integers(-15, 16, picture.shape)
    return TrainingFrame((picture + noise).clip(0, 255).astype(np.uint8), labels, site_seed)
