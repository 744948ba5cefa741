"""Convert .blend files to glTF, each in its own Blender process (docs/assets.md)."""

from __future__ import annotations

import json
import subprocess
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import psutil

from valerie.errors import InvalidInput, RenderingError
from valerie.rendering.cycles.blender import blender_environment, blender_program, interpreter
from valerie.settings import Settings

_MAGIC: Final = (b"BLENDER", b"\x1f\x8b", b"\x28\xb5\x2f\xfd")  # plain, gzip (before 3.0), zstd
#: Interval between checks of the memory and the time limit, seconds.
_LOOK_SECONDS: Final = 0.2


@dataclass(frozen=True, slots=True)
class Conversion:
    """The result of converting a .blend file.

    Attributes:
        path: the glTF file.
        version: the version of Blender.
        notes: one sentence for each part that was left out.
    """

    path: Path
    version: str
    notes: tuple[str, ...]


def convert_blend(source: Path, target: Path, settings: Settings, *, seconds: float = 1800.0) -> Conversion:
    """Convert a .blend file to one binary glTF file without running any of its scripts.

    Args:
        source: the .blend file.
        target: the .glb file to write.
        settings: Blender's interpreter and its memory limit.
        seconds: time limit.

    Raises:
        MissingDependency: there is no Blender environment (``make cycles`` installs it).
        InvalidInput: the file is not a .blend file, Blender cannot read it, or a file cannot be read or written.
        RenderingError: Blender crashed, took too long or used too much memory.
    """
    try:
        with source.open("rb") as file:
            start = file.read(7)
    except OSError as error:
        raise InvalidInput(f"the file cannot be read ({error.strerror})", value=str(source)) from None
    if not start.startswith(_MAGIC):
        raise InvalidInput("not a .blend file", field=source.name, value=start.hex(" "), limit="starts with BLENDER")
    python = interpreter(settings)
    with tempfile.TemporaryDirectory(prefix="valerie-convert-") as folder:
        output, report_path = Path(folder, "scene.glb"), Path(folder, "report.json")
        command = blender_program(python, "inside.convert", str(source.resolve()), str(output), str(report_path))
        with Path(folder, "log").open("w+b") as log:
            _run(command, log, settings.cycles_max_memory_mb * 1_000_000, seconds)
            log.seek(0)
            last = log.read().decode(errors="replace").strip().splitlines()[-1:]
        if not report_path.is_file():
            raise RenderingError(f"Blender ended while it converted {source.name}: {' '.join(last) or 'no message'}")
        report = json.loads(report_path.read_text("utf-8"))
        if "error" in report or not output.is_file():
            raise InvalidInput(f"Blender cannot convert the file: {report.get('error', last)}", field=source.name)
        try:
            target.write_bytes(output.read_bytes())
        except OSError as error:
            raise InvalidInput(f"the file cannot be written ({error.strerror})", value=str(target)) from None
    return Conversion(target, str(report["version"]), tuple(map(str, report["notes"])))


def _run(command: list[str], log: Any, memory: int, seconds: float) -> None:
    """Run a command to its end.

    Raises:
        RenderingError: the command exceeds its memory or its time.
    """
    until = time.monotonic() + seconds
    process = subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=log, stderr=subprocess.STDOUT, env=blender_environment()
    )
    try:
        while True:
            try:
                process.wait(_LOOK_SECONDS)
                return
            except subprocess.TimeoutExpired:
                _require_modesty(process.pid, memory)
                if time.monotonic() > until:
                    raise RenderingError(f"Blender did not finish within {seconds:g} s") from None
    finally:
        process.kill()
        process.wait()


def _require_modesty(pid: int, memory: int) -> None:
    try:
        size = psutil.Process(pid).memory_info().rss
    except psutil.Error:
        return  # the process has just ended
    if size > memory:
        raise RenderingError(f"Blender took {size / 1e6:,.0f} MB; VALERIE_CYCLES_MAX_MEMORY_MB is {memory / 1e6:,.0f}")
