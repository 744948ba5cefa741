# SPDX-License-Identifier: Apache-2.0
"""Read requests from one pipe, render with Cycles, and answer over another.

``python -m inside FOLDER``: FOLDER takes temporary images. The ``kind`` of a request names a method of `studio.Studio`. Every
request gets one answer. While Cycles renders, headers {"alive": true} precede it. The program ends with the requests, or with
its parent.
"""

from __future__ import annotations

import os
import sys
import time

from .pipe import Pipe
from .process import die_with_parent
from .studio import Studio


def main(folder: str) -> None:
    """Answer requests until the pipe ends."""
    die_with_parent()
    # Blender prints to standard output. Messages go over copies of the descriptors.
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
            answer, results = getattr(studio, header["kind"])(header, arrays)
        except Exception as error:
            answer, results = {"error": f"{type(error).__name__}: {error}".strip()}, {}
        now = time.process_time()
        pipe.write({**answer, "cpu_seconds": now - cpu}, results)
        cpu = now
    # Blender's regular exit is slow and reports every memory block that it did not free.
    os._exit(0)


if __name__ == "__main__":
    main(sys.argv[1])
