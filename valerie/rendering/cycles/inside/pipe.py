# SPDX-License-Identifier: Apache-2.0
"""Messages over a pipe.

A message is the length of its header (4 bytes, little-endian), the header in JSON, and the bytes of the arrays that the header
lists under ``arrays``: {"name", "dtype", "shape"}.
"""

from __future__ import annotations

import json
import math
import os
import struct
import time
from typing import Any

import numpy as np

#: A message between VALERIE and Blender, without its arrays (`valerie.rendering.cycles.translation`).
Message = dict[str, Any]
#: Arrays, or objects of Blender, which has no types, by name.
ByName = dict[str, Any]

_HEADER = struct.Struct("<I")


class Pipe:
    """This program's end of the two pipes."""

    def __init__(self, requests: int, answers: int) -> None:
        self._requests = os.fdopen(requests, "rb", buffering=1 << 20)
        self._answers = os.fdopen(answers, "wb", buffering=1 << 20)
        self._signed = 0.0

    def read(self) -> tuple[Message, ByName] | None:
        """Read a request, and return its header and arrays, or None at the end of the pipe."""
        length = self._requests.read(_HEADER.size)
        if len(length) < _HEADER.size:
            return None
        header = json.loads(self._requests.read(_HEADER.unpack(length)[0]))
        arrays = {}
        for entry in header.get("arrays", ()):
            dtype, shape = np.dtype(entry["dtype"]), tuple(entry["shape"])
            data = self._requests.read(dtype.itemsize * math.prod(shape))
            arrays[entry["name"]] = np.frombuffer(data, dtype).reshape(shape)
        return header, arrays

    def write(self, header: Message, arrays: ByName | None = None) -> None:
        """Write an answer."""
        arrays = {name: np.ascontiguousarray(array) for name, array in (arrays or {}).items()}
        entries = [{"name": n, "dtype": a.dtype.str, "shape": list(a.shape)} for n, a in arrays.items()]
        text = json.dumps({**header, "arrays": entries}).encode()
        self._answers.write(_HEADER.pack(len(text)) + text)
        for array in arrays.values():
            self._answers.write(array.data)
        self._answers.flush()

    def alive(self, *_: Any) -> None:
        """Write a sign of life, at most two per second."""
        if time.monotonic() - self._signed > 0.5:
            self._signed = time.monotonic()
            self.write({"alive": True})
