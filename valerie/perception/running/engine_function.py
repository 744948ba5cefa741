"""Functions that run in this process: the document's adaptation, an engine, and the class map."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from valerie.errors import InferenceError, InvalidInput
from valerie.perception.base import FunctionCard, require_picture
from valerie.perception.documents.function import FunctionDocument
from valerie.perception.running.adaptation import Size, plan
from valerie.perception.running.engines.base import InferenceEngine


class EngineFunction:
    """A network under test; see `valerie.perception.base.PerceptionFunction`.

    Args:
        document: document of the function.
        engine: engine with the loaded network.
        digest: digest of the function on its card.
    """

    #: Raise it whenever adaptation, normalisation or labelling gives other pixels; part of every prediction's digest.
    revision: ClassVar[int] = 1

    def __init__(self, document: FunctionDocument, engine: InferenceEngine, *, digest: str) -> None:
        self._input = document.input
        self._train_ids = document.output.lookup
        self._engine = engine
        self._card = document.card(digest=digest, precision=engine.precision)

    @property
    def card(self) -> FunctionCard:
        return self._card

    @property
    def numeric_class(self) -> str:
        """See `valerie.perception.running.engines.base.InferenceEngine`."""
        return self._engine.numeric_class

    @property
    def batch_size(self) -> int:
        """Best number of pictures for `predict_many`: more than one on a GPU."""
        return self._engine.batch_size

    def predict(self, picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Return the (H, W) uint8 train ids of an (H, W, 3) uint8 sRGB picture.

        Raises:
            InvalidInput: the picture is not (H, W, 3) uint8, is empty, or is larger than the function takes.
            InferenceError: the engine failed.
        """
        return self.predict_many([picture])[0]

    def predict_many(self, pictures: Sequence[NDArray[np.uint8]]) -> list[NDArray[np.uint8]]:
        """Return the train ids of several pictures of one size; labels do not depend on how pictures are grouped.

        Raises:
            InvalidInput, InferenceError: see `predict`; also pictures of different sizes.
        """
        for picture in pictures:
            require_picture(picture)
        if len({picture.shape for picture in pictures}) > 1:
            raise InvalidInput("pictures of different sizes", field="pictures")
        if not pictures:
            return []
        steps = plan(self._input, *pictures[0].shape[:2])
        pieces = [piece for picture in pictures for piece in steps.pieces(picture)]
        ids: list[NDArray[np.uint8]] = []
        for first in range(0, len(pieces), self.batch_size):
            ids += self._ids(pieces[first : first + self.batch_size], steps.labels)
        each = len(pieces) // len(pictures)
        return [
            self._train_ids[steps.joined(ids[number * each : (number + 1) * each])] for number in range(len(pictures))
        ]

    def close(self) -> None:
        """Free the weights; the instance is unusable afterwards."""
        self._engine.close()

    def _ids(self, pieces: Sequence[NDArray[np.uint8]], labels: Size) -> list[NDArray[np.uint8]]:
        try:
            ids = self._engine.ids(np.stack(pieces), labels)
        except InvalidInput:
            raise
        except Exception as error:  # engines raise errors of their own libraries
            first_line = str(error).strip().partition("\n")[0]
            raise InferenceError(
                f"{self._card.name}: {self._engine.name} failed on a picture of {pieces[0].shape}: {first_line}"
            ) from error
        if ids.shape != (len(pieces), *labels):
            raise InferenceError(f"{self._card.name}: {self._engine.name} answered {ids.shape} instead of {labels}")
        return list(ids)
