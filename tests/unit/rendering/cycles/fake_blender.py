"""A program that answers like the package `inside`, without Blender, and misbehaves as its first argument says."""

import json
import math
import os
import signal
import struct
import sys
import time
from pathlib import Path

behaviour, folder = sys.argv[1], Path(sys.argv[-1])
note = Path(os.environ["TMPDIR"]) / "attempts" if "TMPDIR" in os.environ else folder / "attempts"
requests, answers = sys.stdin.buffer, sys.stdout.buffer


def answer(header, data=b""):
    text = json.dumps({"arrays": [], "cpu_seconds": 0.25, **header}).encode()
    answers.write(struct.pack("<I", len(text)) + text + data)
    answers.flush()


def image(size, border):
    width, height = border[2:] if border else size
    values = [(0.1 + 0.8 * x / width) for _ in range(height) for x in range(width) for _ in range(3)]
    entry = {"name": "pixels", "dtype": "<f4", "shape": [height, width, 3]}
    answer({"arrays": [entry]}, struct.pack(f"<{len(values)}f", *values))


while length := requests.read(4):
    header = json.loads(requests.read(struct.unpack("<I", length)[0]))
    for entry in header["arrays"]:
        requests.read(int(entry["dtype"][-1]) * math.prod(entry["shape"]))
    if header["kind"] == "hello":
        print("starting", file=sys.stderr, flush=True)
        answer({"version": "9.9.9 LTS", "device": "CPU", "device_name": ""})
    elif header["kind"] != "render":
        answer({})
    else:
        first = not note.exists()
        note.touch()
        answer({"alive": True})
        if behaviour == "crashes" or (behaviour == "crashes once" and first):
            print("Segmentation fault", file=sys.stderr, flush=True)
            os.kill(os.getpid(), signal.SIGSEGV)
        elif behaviour == "hangs":
            time.sleep(600)
        elif behaviour == "is slow":
            for _ in range(4):
                time.sleep(0.4)
                answer({"alive": True})
        elif behaviour == "has no memory":
            answer({"error": "RuntimeError: Error: System is out of GPU memory"})
            continue
        elif behaviour == "refuses":
            answer({"error": "RuntimeError: no such socket"})
            continue
        image(header["size"], header["border"])
