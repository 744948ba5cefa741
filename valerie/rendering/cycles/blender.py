"""The Blender process: start it, exchange messages with it, and end it when it crashes, hangs or uses too much memory.

Blender is under the GPL. It runs the programs of the package `inside` in an environment of its own (docs/cycles.md). This
process shares nothing with it but messages over two pipes.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import tempfile
from collections.abc import Mapping
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, Final, TypedDict

import numpy as np
import psutil
from numpy.typing import NDArray

from valerie.errors import MissingDependency, RenderingError, TransientError
from valerie.parameters.definitions import Value
from valerie.parent import Wire
from valerie.plain import JsonObject
from valerie.rendering.surface_constants import CONSTANTS, relief_corners
from valerie.scene.graph.model import Material, Mesh, Texture
from valerie.settings import Settings, load_settings

#: Folder of the package `inside`, which is not installed in Blender's Python. At the end of the path, it hides no other module.
_FOLDER: Final = Path(__file__).parent
_START: Final = (
    "import runpy, sys; sys.path.append(sys.argv.pop(1)); "
    "runpy.run_module(sys.argv.pop(1), run_name='__main__', alter_sys=True)"
)
#: Longest time for importing Blender and listing its devices, seconds.
_START_SECONDS: Final = 120.0
#: Blender's messages when it runs out of memory.
_OUT_OF_MEMORY: Final = re.compile(r"out of (\w+ )?memory|MemoryError|failed to allocate", re.IGNORECASE)
#: Bytes at the end of Blender's log in which an error message looks for the last line.
_LONGEST_LOG: Final = 2_000

Arrays = Mapping[str, NDArray[Any]]


class BlenderAnswer(TypedDict, total=False):
    """Header of an answer of Blender. ``hello`` has the version and the device."""

    cpu_seconds: float
    error: str
    version: str
    device: str
    device_name: str


class BlenderProcess:
    """One Blender process. It ends with its first failure and is not started again.

    Args:
        settings: interpreter, device, threads, limits of time and memory.

    Attributes:
        known: the objects that Blender holds, by key; maintained by the owner.
        settings: the settings of Cycles' persistent data; maintained by the owner.
        version, device, device_name: Blender's own report; the device is ``CPU``, ``CUDA``, ``OPTIX`` ….
        cpu_seconds: CPU time of all requests so far.

    Raises:
        MissingDependency: there is no environment with Blender, or the machine lacks the configured device.
        TransientError: Blender does not start.
    """

    def __init__(self, settings: Settings) -> None:
        python = interpreter(settings)
        self._silence = settings.cycles_silence_seconds
        self._memory = settings.cycles_max_memory_mb * 1_000_000
        self._folder = tempfile.TemporaryDirectory(prefix="valerie-cycles-")
        self._log = tempfile.TemporaryFile()  # noqa: SIM115  lives as long as the process
        self.known: dict[str, Mesh | Material | Texture] = {}
        self.settings: Mapping[str, Value] | None = None
        self.cpu_seconds = 0.0
        self._process: subprocess.Popen[bytes] | None = subprocess.Popen(
            blender_program(python, "inside", self._folder.name),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._log,
            env=blender_environment(),
        )
        self.pid = self._process.pid
        device = settings.cycles_device
        answer, _ = self.ask(
            "hello",
            {"reliefs": relief_corners()},
            silence=_START_SECONDS,
            device=device,
            threads=settings.cycles_threads,
            constants=dict(CONSTANTS),
        )
        self.version, self.device = answer["version"], answer["device"]
        self.device_name = answer["device_name"]
        if device not in ("auto", self.device.lower()):
            self.close()
            raise MissingDependency(f"VALERIE_CYCLES_DEVICE is {device}, but Blender finds no such device here")

    @property
    def alive(self) -> bool:
        return self._process is not None and self._process.poll() is None

    def ask(
        self, kind: str, arrays: Arrays | None = None, *, silence: float | None = None, **header: Any
    ) -> tuple[BlenderAnswer, dict[str, NDArray[Any]]]:
        """Send a request and return its answer: header and arrays.

        Args:
            kind: a method of `inside.studio.Studio`.
            arrays: arrays of the request by name.
            silence: seconds without a sign of life after which Blender counts as hung; None takes the setting.
            header: further entries of the request's header.

        Raises:
            TransientError: Blender ended, hung, or exceeded its memory. Its process is gone.
            RenderingError: Blender reports an error.
        """
        limit = self._silence if silence is None else silence
        answer, results = self._exchange({"kind": kind, **header}, arrays or {}, limit)
        self.cpu_seconds += answer.get("cpu_seconds", 0.0)
        if "error" in answer:
            if _OUT_OF_MEMORY.search(answer["error"]):
                raise self._ended(f"Blender says {answer['error']!r}")
            raise RenderingError(f"cycles: {answer['error']}")
        return answer, results

    def reset(self) -> None:
        """Clear Blender's scene and Cycles' caches. Raises the errors of `ask`."""
        self.ask("reset")
        self.known.clear()
        self.settings = None

    def close(self) -> None:
        """End the process if it still runs, and remove its folder."""
        process, self._process = self._process, None
        if process is None:
            return
        for pipe in (process.stdin, process.stdout):
            assert pipe is not None
            with suppress(OSError):  # the buffered bytes are not needed
                pipe.close()
        process.kill()
        process.wait()
        self._log.close()
        self._folder.cleanup()

    def _exchange(
        self, header: JsonObject, arrays: Arrays, silence: float
    ) -> tuple[BlenderAnswer, dict[str, NDArray[Any]]]:
        if not self.alive:
            raise self._ended("Blender is not running")
        outgoing = {name: np.ascontiguousarray(array) for name, array in arrays.items()}
        entries = [{"name": n, "dtype": a.dtype.str, "shape": a.shape} for n, a in outgoing.items()]
        text = json.dumps({**header, "arrays": entries}).encode()
        assert self._process is not None
        assert self._process.stdin is not None
        wire = Wire(self._process.stdin, self._process.stdout, self._watch, silence)
        try:
            wire.send_message(text)
            for array in outgoing.values():
                wire.send(array.reshape(-1).view(np.uint8).data)
            while True:
                answer = json.loads(wire.receive_message())
                if "alive" not in answer:
                    break
            incoming = {}
            for entry in answer["arrays"]:
                dtype = np.dtype(entry["dtype"])
                data = wire.receive(dtype.itemsize * int(np.prod(entry["shape"], dtype=np.int64)))
                incoming[entry["name"]] = np.frombuffer(data, dtype).reshape(entry["shape"])
        except EOFError:
            raise self._ended("Blender ended in the middle of its work") from None
        except TimeoutError:
            raise self._ended(f"Blender gave no sign of life for {silence:g} s") from None
        except MemoryError as error:
            raise self._ended(str(error)) from None
        except BaseException:
            self.close()  # the next request would read the rest of this answer
            raise
        return answer, incoming

    def _watch(self) -> None:
        assert self._process is not None
        try:
            size = psutil.Process(self._process.pid).memory_info().rss
        except psutil.Error:
            return  # the process has just ended; the pipe reports it
        if size > self._memory:
            raise MemoryError(
                f"Blender took {size / 1e6:,.0f} MB; VALERIE_CYCLES_MAX_MEMORY_MB is {self._memory / 1e6:,.0f}"
            )

    def _ended(self, reason: str) -> TransientError:
        """Make sure that the process is gone, and return the error to raise."""
        log = ""
        if self._process is not None:
            self._process.kill()
            status = self._process.wait()
            self._log.seek(0, os.SEEK_END)
            self._log.seek(max(self._log.tell() - _LONGEST_LOG, 0))
            lines = self._log.read().decode(errors="replace").strip().splitlines()
            log = f" (status {status}{': ' + lines[-1] if lines else ''})"
        self.close()
        return TransientError(f"cycles: {reason}{log}")


def interpreter(settings: Settings) -> Path:
    """Return the path of the Python interpreter with Blender.

    Raises:
        MissingDependency: there is no interpreter at the path.
    """
    # Not resolved: the interpreter of a virtual environment is a link to one outside it.
    python = settings.cycles_python
    if not (python.is_file() and os.access(python, os.X_OK)):
        raise MissingDependency(
            f"there is no Blender environment ({python} is missing): install it with `make cycles`, or set "
            "VALERIE_CYCLES_PYTHON to the python of an environment with bpy"
        )
    return python


@cache
def process_blender(pid: int) -> BlenderHolder:
    """Return the Blender of this process. ``pid`` is the process's own: a forked child must not use its parent's pipes."""
    assert pid == os.getpid()
    return BlenderHolder(load_settings())


class BlenderHolder:
    """The current Blender process: started on first use, and again after a failure.

    Attributes:
        cpu_seconds: CPU time of all Blender processes so far.
    """

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._blender: BlenderProcess | None = None
        self._past_cpu_seconds = 0.0

    @property
    def cpu_seconds(self) -> float:
        return self._past_cpu_seconds + (self._blender.cpu_seconds if self._blender is not None else 0.0)

    def get(self) -> BlenderProcess:
        """Return the running Blender process; start one if there is none. Raises the errors of `BlenderProcess`."""
        if self._blender is None or not self._blender.alive:
            self.close()
            self._blender = BlenderProcess(self._settings)
        return self._blender

    def close(self) -> None:
        """End the Blender process, if there is one."""
        if self._blender is not None:
            self._past_cpu_seconds += self._blender.cpu_seconds
            self._blender.close()
            self._blender = None


def blender_program(python: Path, module: str, *arguments: str) -> list[str]:
    """Return the command that runs a module of `inside` in Blender's Python, isolated from this process's environment."""
    return [str(python), "-I", "-B", "-c", _START, str(_FOLDER), module, *arguments]


def blender_environment() -> dict[str, str]:
    """Return Blender's environment variables, without VALERIE's settings and tokens and the user's Blender settings."""
    names = (
        "PATH",
        "LANG",
        "LC_ALL",
        "TMPDIR",
        "LD_LIBRARY_PATH",
        "CUDA_VISIBLE_DEVICES",
        "HIP_VISIBLE_DEVICES",
        "SYSTEMROOT",
    )
    inherited = {name: os.environ[name] for name in names if name in os.environ}
    return {**inherited, "HOME": tempfile.gettempdir(), "BLENDER_USER_RESOURCES": os.devnull}
