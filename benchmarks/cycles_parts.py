"""Parts of pictures in a folder, one line of JSON each: what was made once is not made again, whenever the work is ended.

``setup.json`` says what all parts of the folder were made with; ``parts.jsonl`` has a line for each part, written after its
arrays: what a crash cut off is made again.
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
        folder: made if it is not there.
        setup: what parts have to be made with to be comparable.

    Raises:
        InvalidInput: the folder holds parts that were made with something else.
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
        """What was noted of each part."""
        return iter(self._records.values())

    def figures(self, key: str) -> dict[str, Any]:
        """What was noted of a part."""
        return dict(self._records[key])

    def arrays(self, key: str) -> dict[str, NDArray[Any]]:
        with np.load(self._file(key)) as found:
            return {name: found[name] for name in found.files}

    def add(self, key: str, arrays: Arrays, **figures: Any) -> None:
        """Keep a part for good."""
        np.savez(self._file(key), **dict[str, Any](arrays))
        record = {"key": key, **figures}
        append_line(self._lines, record)
        self._records[key] = record

    def remove_arrays(self, keys: Iterable[str]) -> None:
        """Keep what was noted of parts that went into another one, not their arrays."""
        for key in keys:
            self._file(key).unlink(missing_ok=True)

    def _file(self, key: str) -> Path:
        return self._folder / f"{key.replace('/', '-')}.npz"


def append_line(path: Path, record: Mapping[str, Any]) -> None:
    """One line at the end, flushed; a line that a crash cut off is ended first."""
    with path.open("a+b") as lines:
        size = lines.seek(0, os.SEEK_END)
        lines.seek(max(size - 1, 0))
        broken = size > 0 and lines.read(1) != b"\n"
        lines.write(b"\n" * broken + json.dumps(dict(record)).encode() + b"\n")
        lines.flush()


def read_lines(path: Path) -> Iterator[dict[str, Any]]:
    """The whole lines of a file; what a crash cut off is left out."""
    with suppress(FileNotFoundError):
        for line in path.read_text().splitlines():
            with suppress(json.JSONDecodeError):
                yield json.loads(line)
