"""A function behind an HTTP address that the operator allows. Each picture is one POST, and the answer is its label map.

The contract is in docs/functions.md. An answer that is late, too large or malformed is a failure of that picture, which is
recorded with its reason. The picture is not sent again, since a second answer would hide that the first one failed.
"""

from __future__ import annotations

import http.client
import socket
import ssl
import threading
from collections.abc import Sequence
from dataclasses import replace
from typing import ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from valerie.errors import InferenceError, InvalidInput
from valerie.perception.base import FunctionCard
from valerie.perception.documents.addresses import Endpoint, allowed_target, parse_allowed
from valerie.perception.documents.function import FunctionDocument
from valerie.perception.documents.options import HttpOptions
from valerie.perception.running.label_png import decode_labels, encode_png, max_label_bytes

#: Headers of the contract: the function's name, and the endpoint's version.
FUNCTION_HEADER: Final = "Valerie-Function"
VERSION_HEADER: Final = "Function-Version"
_PIECE: Final = 65_536


class HttpFunction:
    """See `valerie.perception.base.PerceptionFunction`.

    Args:
        document: document of kind ``http``.
        allowed: the operator's list; see `valerie.perception.documents.addresses`.
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
            InferenceError: the answer is late, has a status other than 200 or another version, or is no label map of the frame.
        """
        if picture.dtype != np.uint8 or picture.ndim != 3 or picture.shape[2] != 3 or picture.size == 0:
            layout = f"{picture.dtype} {picture.shape}"
            raise InvalidInput("not a picture", field="picture", value=layout, limit="(H, W, 3) uint8, not empty")
        height, width = picture.shape[:2]
        target = allowed_target(self._options.url, self._allowed)
        answer = self._ask(target, encode_png(picture), max_label_bytes(height, width))
        try:
            ids = decode_labels(answer, height, width, field="answer")
        except InvalidInput as error:
            raise InferenceError(f"{self._card.name}: {error}") from None
        labels: NDArray[np.uint8] = self._train_ids[ids]
        return labels

    def close(self) -> None:
        """Do nothing: no connection is kept between pictures."""

    def _ask(self, target: Endpoint, body: bytes, limit: int) -> bytes:
        connection = _Connection(target, self._options.timeout_s)
        late = threading.Event()

        def end() -> None:
            late.set()
            connection.cut()

        # The socket's time-out restarts with every byte; this one does not.
        timer = threading.Timer(self._options.timeout_s, end)
        timer.daemon = True
        timer.start()
        try:
            return self._exchange(connection, target, body, limit)
        except (OSError, http.client.HTTPException, ValueError, InferenceError) as error:
            if late.is_set() or isinstance(error, TimeoutError):
                reason = f"no answer within {self._options.timeout_s:g} s"
            else:
                reason = str(error) if isinstance(error, InferenceError) else repr(error)
            raise InferenceError(f"{self._card.name}: {target.host}:{target.port}: {reason}") from None
        finally:
            timer.cancel()
            connection.close()

    def _exchange(self, connection: http.client.HTTPConnection, target: Endpoint, body: bytes, limit: int) -> bytes:
        headers = {
            "Content-Type": "image/png",
            "Accept": "image/png",
            "Accept-Encoding": "identity",
            FUNCTION_HEADER: self._card.name,
            "Connection": "close",
        }
        connection.request("POST", target.path, body=body, headers=headers)
        response = connection.getresponse()
        if response.status != http.client.OK:  # redirects too: their target was not allowed
            raise InferenceError(f"it answered with status {response.status}")
        version = response.getheader(VERSION_HEADER, "")
        if self._options.version and version != self._options.version:
            raise InferenceError(f"it has version {version!r}; {self._options.version!r} is registered")
        pieces: list[bytes] = []
        size = 0
        while piece := response.read1(_PIECE):
            size += len(piece)
            if size > limit:
                raise InferenceError(f"it answered with more than {limit} bytes")
            pieces.append(piece)
        if response.length:
            raise InferenceError(f"it ended {response.length} bytes early")
        return b"".join(pieces)


class _Connection(http.client.HTTPConnection):
    """A connection to the allowed address, with a check of the named host's certificate."""

    def __init__(self, target: Endpoint, timeout_s: float) -> None:
        super().__init__(target.host, target.port, timeout=timeout_s)
        self._target = target

    def connect(self) -> None:
        plain = socket.create_connection((self._target.address, self.port), self.timeout)
        if self._target.secure:
            context = ssl.create_default_context()
            self.sock = context.wrap_socket(plain, server_hostname=self.host)
        else:
            self.sock = plain

    def cut(self) -> None:
        """End the connection from another thread, even while it waits."""
        sock = self.sock
        if sock is not None:
            try:
                sock.shutdown(socket.SHUT_RDWR)
            except OSError:
                return
