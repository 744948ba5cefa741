"""Keep parts of pictures in a folder, so that an interrupted run never renders a part twice.

``setup.json`` states the setup of all parts of the folder. ``parts.jsonl`` has a line for each part, written after its arrays:
a part that a crash cut off has no line and is rendered again.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from valerie.errors import InvalidInput

Arrays = Mapping[str, NDArray[Any]]


class Parts:
    """The parts of one folder.

    Args:
        folder: created if missing.
        setup: the setup that makes parts comparable.

    Raises:
        InvalidInput: the folder contains parts of another setup.
    """

    def __init__(self, folder: Path, setup: Mapping[str, Any]) -> None:
        self._folder = folder
        folder.mkdir(parents=True, exist_ok=True)
        note = folder / "setup.json"
        if note.exists():
            there = json.loads(note.read_text())
            for name in sorted({*there, *setup}):
                if there.get(name) != setup.get(name):
                    raise InvalidInput(
                        f"the parts in {folder} were made with {name} {there.get(name)!r}, not {setup.get(name)!r}: "
                        "name another folder"
                    )
        else:
            note.write_text(json.dumps(dict(setup), indent=2) + "\n")
        self._lines = folder / "parts.jsonl"
        self._records = {record["key"]: record for record in read_lines(self._lines)}

    def __contains__(self, key: str) -> bool:
        return key in self._records

    def __iter__(self) -> Iterator[dict[str, Any]]:
        """Yield the record of each part."""
        return iter(self._records.values())

    def figures(self, key: str) -> dict[str, Any]:
        """Return the record of a part."""
        return dict(self._records[key])

    def arrays(self, key: str) -> dict[str, NDArray[Any]]:
        with np.load(self._file(key)) as archive:
            return {name: archive[name] for name in archive.files}

    def add(self, key: str, arrays: Arrays, **figures: Any) -> None:
        """Store a part for good."""
        np.savez(self._file(key), **dict[str, Any](arrays))
        record = {"key": key, **figures}
        append_line(self._lines, record)
        self._records[key] = record

    def remove_arrays(self, keys: Iterable[str]) -> None:
        """Remove the arrays of parts that were merged into another part; keep their records."""
        for key in keys:
            self._file(key).unlink(missing_ok=True)

    def _file(self, key: str) -> Path:
        return self._folder / f"{key.replace('/', '-')}.npz"


def append_line(path: Path, record: Mapping[str, Any]) -> None:
    """Append a line and flush it; a line that a crash cut off is ended first."""
    with path.open("a+b") as lines:
        size = lines.seek(0, os.SEEK_END)
        lines.seek(max(size - 1, 0))
        broken = size > 0 and lines.read(1) != b"\n"
        lines.write(b"\n" * broken + json.dumps(dict(record)).encode() + b"\n")
        lines.flush()


def read_lines(path: Path) -> Iterator[dict[str, Any]]:
    """Yield the records of a file, without lines that a crash cut off."""
    with suppress(FileNotFoundError):
        for line in path.read_text().splitlines():
            with suppress(json.JSONDecodeError):
                yield json.loads(line)
