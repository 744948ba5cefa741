"""A function behind an HTTP address that the operator allows. Each picture is one POST, and the answer is its label map.

The contract is in docs/functions.md. An answer that is late, too large or malformed is a failure of that picture, which is
recorded with its reason. The picture is not sent again, since a second answer would hide that the first one failed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from valerie.addresses import allowed_target, parse_allowed
from valerie.errors import InferenceError, InvalidInput, NoAnswer
from valerie.outbound import post
from valerie.perception.base import FunctionCard, require_picture
from valerie.perception.documents.function import FunctionDocument
from valerie.perception.documents.options import HttpOptions
from valerie.perception.running.label_png import decode_labels, encode_png, max_label_bytes

#: Headers of the contract: the function's name, and the endpoint's version.
FUNCTION_HEADER: Final = "Valerie-Function"
VERSION_HEADER: Final = "Function-Version"


class HttpFunction:
    """See `valerie.perception.base.PerceptionFunction`.

    Args:
        document: document of kind ``http``.
        allowed: the operator's list; see `valerie.addresses`.
        digest: digest of the function on its card.

    Raises:
        InvalidInput: the address is not on the list.
    """

    #: Raise it whenever equal answers give other labels.
    revision: ClassVar[int] = 1
    #: The endpoint's hardware and libraries are unknown here.
    numeric_class: Final = "http"

    def __init__(self, document: FunctionDocument, *, allowed: Sequence[str], digest: str) -> None:
        assert isinstance(document.options, HttpOptions), "the document's kind is http"
        self._options = document.options
        self._allowed = parse_allowed(allowed)
        allowed_target(self._options.url, self._allowed)
        self._train_ids = document.output.lookup
        card = document.card(digest=digest, precision="remote")
        self._card = replace(card, engine="http")

    @property
    def card(self) -> FunctionCard:
        return self._card

    def predict(self, picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Return the (H, W) uint8 train ids of an (H, W, 3) uint8 sRGB picture.

        Raises:
            InvalidInput: the picture is not (H, W, 3) uint8, or the address is no longer allowed.
            InferenceError: the host has no address, or the answer is late, has a status other than 200 or another version, or
                is no label map of the frame.
        """
        require_picture(picture)
        height, width = picture.shape[:2]
        headers = {
            "Content-Type": "image/png",
            "Accept": "image/png",
            "Accept-Encoding": "identity",
            FUNCTION_HEADER: self._card.name,
        }
        limit = max_label_bytes(height, width)
        try:
            target = allowed_target(self._options.url, self._allowed)
            answer = post(target, encode_png(picture), headers, timeout_s=self._options.timeout_s, limit=limit)
        except NoAnswer as error:
            raise InferenceError(f"{self._card.name}: {error}") from None
        version = answer.headers.get(VERSION_HEADER, "")
        if self._options.version and version != self._options.version:
            raise InferenceError(
                f"{self._card.name}: {target.host}:{target.port}: it has version {version!r}; "
                f"{self._options.version!r} is registered"
            )
        try:
            ids = decode_labels(answer.body, height, width, field="answer")
        except InvalidInput as error:
            raise InferenceError(f"{self._card.name}: {error}") from None
        labels: NDArray[np.uint8] = self._train_ids[ids]
        return labels

    def close(self) -> None:
        """Do nothing: no connection is kept between pictures."""
