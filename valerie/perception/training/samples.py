"""Samples from frames: crops at several scales, mirrored and recoloured, with one random generator per sample."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from functools import lru_cache
from itertools import islice

import cv2
import numpy as np
from numpy.typing import NDArray

from valerie.labels import PERSON, VOID
from valerie.perception.training.frame_folder import TrainingFrame
from valerie.perception.training.training_settings import CropSettings, TrainingSettings

PictureArray = NDArray[np.uint8]
Labels = NDArray[np.uint8]
#: (B, H, W, 3) uint8 pictures and (B, H, W) uint8 train ids.
SampleBatch = tuple[NDArray[np.uint8], NDArray[np.uint8]]


def cut(
    frame: TrainingFrame, settings: CropSettings, rng: np.random.Generator, *, longest_side: int | None = None
) -> tuple[PictureArray, Labels]:
    """Cut one sample from a frame; scales refer to the picture that the function sees, reduced to ``longest_side`` if longer.

    A window of the sample's size divided by the scale is cut and resampled (pictures by area or linearly, labels by the nearest
    pixel centre). If the frame is smaller than the window, black void pixels fill the rest.

    Returns:
        (height, width, 3) uint8 picture and (height, width) uint8 train ids.
    """
    jitter = float(np.exp(rng.uniform(-1.0, 1.0) * np.log(settings.scale_jitter)))
    reduced = 1.0 if longest_side is None else min(1.0, longest_side / max(frame.train_ids.shape))
    scale = float(rng.choice(settings.scales)) * jitter * reduced
    rows = _window(frame.train_ids.shape[0], settings.height, scale)
    columns = _window(frame.train_ids.shape[1], settings.width, scale)
    top, left = _place(frame.train_ids, rows, columns, settings.person_share, rng)
    picture = frame.picture[top : top + rows, left : left + columns]
    labels = frame.train_ids[top : top + rows, left : left + columns]
    height = min(settings.height, max(1, round(rows * scale)))
    width = min(settings.width, max(1, round(columns * scale)))
    smooth = cv2.INTER_AREA if scale < 1.0 else cv2.INTER_LINEAR
    picture = np.asarray(cv2.resize(picture, (width, height), interpolation=smooth), np.uint8)
    labels = np.asarray(cv2.resize(labels, (width, height), interpolation=cv2.INTER_NEAREST_EXACT), np.uint8)
    if rng.random() < settings.flip_share:
        picture, labels = picture[:, ::-1], labels[:, ::-1]
    whole = np.zeros((settings.height, settings.width, 3), np.uint8)
    whole_labels = np.full((settings.height, settings.width), VOID, np.uint8)
    whole[:height, :width] = recolour(np.ascontiguousarray(picture), settings, rng)
    whole_labels[:height, :width] = labels
    return whole, whole_labels


def recolour(picture: PictureArray, settings: CropSettings, rng: np.random.Generator) -> PictureArray:
    """Change exposure, white balance, contrast and saturation, blur and add noise; labels stay valid."""
    stops = rng.uniform(-1.0, 1.0) * settings.exposure_stops
    balance = 1.0 + rng.uniform(-1.0, 1.0, 3) * settings.white_balance
    contrast = 1.0 + rng.uniform(-1.0, 1.0) * settings.contrast
    saturation = 1.0 + rng.uniform(-1.0, 1.0) * settings.saturation
    values = np.arange(256) / 255.0
    table = (values[:, None] ** 2.2 * (2.0**stops * balance)) ** (1.0 / 2.2)
    table = ((table - 0.5) * contrast + 0.5).clip(0.0, 1.0) * 255.0
    changed = cv2.LUT(picture, table.astype(np.float32).reshape(256, 1, 3)).astype(np.float32)
    grey = changed @ np.array([0.299, 0.587, 0.114], np.float32)
    changed = grey[..., None] + (changed - grey[..., None]) * np.float32(saturation)
    if rng.random() < settings.blur_share:
        changed = np.asarray(cv2.GaussianBlur(changed, (0, 0), float(rng.uniform(0.4, 1.0))), np.float32)
    deviation = rng.uniform(0.0, 1.0) * settings.noise
    changed = changed + rng.standard_normal(changed.shape, np.float32) * np.float32(deviation)
    return np.asarray(np.rint(changed).clip(0.0, 255.0), np.uint8)


def batches(
    frames: Sequence[TrainingFrame], settings: TrainingSettings, first_step: int
) -> Generator[SampleBatch, None, None]:
    """Yield batches from ``first_step`` to the last step, prepared ahead in threads.

    Every pass over the data uses each frame once, in its own order. A sample depends only on the seed, its step and its place
    in the batch, not on threads or interruptions.
    """

    def sample(step: int, slot: int) -> tuple[PictureArray, Labels]:
        turn, place = divmod(step * settings.batch + slot, len(frames))
        frame = frames[int(_order(settings.seed, turn, len(frames))[place])]
        rng = np.random.default_rng([settings.seed, step, slot])
        return cut(frame, settings.crops, rng, longest_side=settings.longest_side)

    def start(pool: ThreadPoolExecutor, step: int) -> list[Future[tuple[PictureArray, Labels]]]:
        return [pool.submit(sample, step, slot) for slot in range(settings.batch)]

    with ThreadPoolExecutor(settings.loader_threads) as pool:
        steps = iter(range(first_step, settings.steps))
        waiting = [start(pool, step) for step in islice(steps, 4)]
        try:
            while waiting:
                samples = [future.result() for future in waiting.pop(0)]
                waiting.extend(start(pool, step) for step in islice(steps, 1))
                yield np.stack([picture for picture, _ in samples]), np.stack([labels for _, labels in samples])
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def _window(available: int, length: int, scale: float) -> int:
    """Return the length of the window in frame pixels."""
    return max(1, min(available, round(length / scale)))


def _place(labels: Labels, rows: int, columns: int, person_share: float, rng: np.random.Generator) -> tuple[int, int]:
    """Draw the top left pixel of the window, inside the frame."""
    height, width = labels.shape
    if rng.random() < person_share:
        places = np.flatnonzero(labels == PERSON.train_id)
        if places.size:
            row, column = divmod(int(rng.choice(places)), width)
            top = row - int(rng.integers(rows))
            left = column - int(rng.integers(columns))
            return min(max(top, 0), height - rows), min(max(left, 0), width - columns)
    return int(rng.integers(height - rows + 1)), int(rng.integers(width - columns + 1))


@lru_cache(maxsize=4)
def _order(seed: int, turn: int, count: int) -> NDArray[np.int64]:
    """Draw the order of the frames in one pass, from a random stream separate from those of the samples."""
    return np.random.default_rng([seed, turn, count, 0x0DE5]).permutation(count)
