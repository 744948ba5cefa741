"""Prediction of many pictures with one function, in batches where that is cheaper, with a check of each label map's size."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from valerie.errors import InferenceError
from valerie.perception.base import BatchFunction, PerceptionFunction

Owner = TypeVar("Owner")


def predicted(
    function: PerceptionFunction, pictures: Iterable[tuple[Owner, NDArray[np.uint8]]]
) -> Iterator[tuple[Owner, NDArray[np.uint8]]]:
    """Yield the labels of every picture, in order. One batch of pictures is read ahead.

    Args:
        function: the function under test.
        pictures: the owner of each picture, and the (H, W, 3) uint8 picture.

    Yields:
        The owner, and (H, W) uint8 train ids.

    Raises:
        InferenceError: the label map has another size than the picture.
    """
    most = function.batch_size if isinstance(function, BatchFunction) else 1
    waiting: list[tuple[Owner, NDArray[np.uint8]]] = []
    for owner, picture in pictures:
        if waiting and picture.shape != waiting[0][1].shape:
            yield from _together(function, waiting)
            waiting = []
        waiting.append((owner, picture))
        if len(waiting) >= most:
            yield from _together(function, waiting)
            waiting = []
    yield from _together(function, waiting)


def require_size(name: str, labels: NDArray[np.uint8], picture: NDArray[np.uint8]) -> None:
    """Refuse a label map that does not fit the picture.

    Raises:
        InferenceError: names the function and both sizes.
    """
    if labels.shape != picture.shape[:2]:
        raise InferenceError(f"{name} returned labels of shape {labels.shape} for a picture of {picture.shape[:2]}")


def _together(
    function: PerceptionFunction, waiting: list[tuple[Owner, NDArray[np.uint8]]]
) -> Iterator[tuple[Owner, NDArray[np.uint8]]]:
    if len(waiting) > 1 and isinstance(function, BatchFunction):
        answers = function.predict_many([picture for _, picture in waiting])
    else:
        answers = [function.predict(picture) for _, picture in waiting]
    for (owner, picture), labels in zip(waiting, answers, strict=True):
        require_size(function.card.name, labels, picture)
        yield owner, labels
