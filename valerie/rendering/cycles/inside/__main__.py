# SPDX-License-Identifier: Apache-2.0
"""Reads scenes from one pipe, renders them with Cycles, answers into another.

``python -m inside FOLDER``: FOLDER takes temporary pictures. Requests have a ``kind``: the name of a method of `studio.Studio`.
Every request gets one answer; while Cycles renders, headers {"alive": true} come before it. End of the requests ends the
program, and so does its parent's death.
"""

from __future__ import annotations

import os
import sys
import time

from .pipe import Pipe
from .process import die_with_parent
from .studio import Studio


def main(folder: str) -> None:
    """Answer requests until there are no more."""
    die_with_parent()
    # Blender prints to standard output; the conversation goes over copies.
    requests, answers = os.dup(0), os.dup(1)
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(2, 1)
    pipe = Pipe(requests, answers)
    import bpy

    studio = Studio(bpy, folder, pipe)
    cpu = time.process_time()
    while (request := pipe.read()) is not None:
        header, arrays = request
        try:
            answer, made = getattr(studio, header["kind"])(header, arrays)
        except Exception as error:
            answer, made = {"error": f"{type(error).__name__}: {error}".strip()}, {}
        now = time.process_time()
        pipe.write({**answer, "cpu_seconds": now - cpu}, made)
        cpu = now
    # Blender's own end reports every block that it did not free, and takes its time.
    os._exit(0)


if __name__ == "__main__":
    main(sys.argv[1])
