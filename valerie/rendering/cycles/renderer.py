"""The physically based engine: Blender's Cycles, a path tracer, in a process of its own.

What is rendered and in which units: `translation`. How far movables reach: `reach`. The process: `blender`.
"""

from __future__ import annotations

import os
import re
from pathlib import Path
from platform import machine
from typing import ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from valerie.rendering.base import Layer, LinearImage, Rectangle, View, require_image
from valerie.rendering.cycles import translation
from valerie.rendering.cycles.blender import BlenderHolder, process_blender
from valerie.rendering.cycles.reach import denoised_window, reached_rectangle
from valerie.rendering.cycles.settings import CyclesSettings
from valerie.scene.graph.model import Scene

_BRIGHTEST: Final = float(np.finfo(np.float16).max)


class CyclesRenderer:
    """Images by Cycles; see `valerie.rendering.base.Renderer` for the contract.

    Args:
        settings: of the pictures.
        holder: of the Blender to use; the process's own if not given.

    Raises:
        MissingDependency: there is no Blender environment (``make cycles`` makes it).
    """

    name: ClassVar[str] = "cycles"
    revision: ClassVar[int] = 6

    def __init__(self, settings: CyclesSettings | None = None, holder: BlenderHolder | None = None) -> None:
        self._settings = (settings or CyclesSettings()).inputs()
        self._holder = holder or process_blender(os.getpid())
        blender = self._holder.get()
        self._numeric_class = numeric_class(blender.version, blender.device, blender.device_name)

    @property
    def numeric_class(self) -> str:
        """See `valerie.rendering.base.Renderer`."""
        return self._numeric_class

    @property
    def cpu_seconds_elsewhere(self) -> float:
        """CPU seconds that Blender has used so far in this process's service."""
        return self._holder.cpu_seconds

    def background(self, scene: Scene, view: View) -> LinearImage:
        """Render the frame without movables.

        Raises:
            RenderingError: The image is constant or not finite.
        """
        return LinearImage(self._whole(scene, view, movables=False))

    def layer(self, scene: Scene, view: View) -> Layer:
        """Render the rectangle that movables change noticeably; the layer is empty if they change none."""
        rectangle = reached_rectangle(scene, view)
        if rectangle.empty:
            return Layer(rectangle, np.zeros((0, 0, 3), np.float16))
        # The denoiser looks around a pixel: what it needs is rendered too and thrown away.
        around = denoised_window(rectangle, view) if self._settings["denoise"] else rectangle
        pixels = self._render(scene, view, around, movables=True)
        rows, columns = rectangle.y - around.y, rectangle.x - around.x
        part = pixels[rows : rows + rectangle.height, columns : columns + rectangle.width]
        return Layer(rectangle, np.ascontiguousarray(part))

    def full(self, scene: Scene, view: View) -> LinearImage:
        """Render the whole frame after Blender has dropped all of its caches."""
        self._holder.get().reset()
        return LinearImage(self._whole(scene, view, movables=True))

    def close(self) -> None:
        """Blender stays with the process, which other instances share; it ends with the process."""

    def _whole(self, scene: Scene, view: View, *, movables: bool) -> NDArray[np.float16]:
        pixels = self._render(scene, view, None, movables=movables)
        require_image(pixels, engine=self.name)
        return pixels

    def _render(self, scene: Scene, view: View, border: Rectangle | None, *, movables: bool) -> NDArray[np.float16]:
        pixels = translation.render(self._holder.get(), scene, view, self._settings, border=border, movables=movables)
        return np.clip(pixels, 0.0, _BRIGHTEST).astype(np.float16)


def numeric_class(version: str, device: str, device_name: str) -> str:
    """E.g. ``bpy-4.5.15-cpu-avx2`` or ``bpy-4.5.15-optix-nvidia-l4``: Cycles and its denoiser have code for each kind of device.

    Samples and the like are settings, not part of the class; neither is the number of threads, which changes no bit.
    """
    kind = _instruction_set() if device == "CPU" else device_name
    return re.sub(r"[^a-z0-9.]+", "-", f"bpy {version.removesuffix(' LTS')} {device} {kind}".lower()).strip("-")


def _instruction_set() -> str:
    """Return the widest of the instruction sets that Cycles or its denoiser have code of their own for."""
    try:
        lines = Path("/proc/cpuinfo").read_text("ascii", "replace").splitlines()
    except OSError:  # not Linux
        lines = []
    flags = next((set(line.partition(":")[2].split()) for line in lines if line.startswith("flags")), set())
    return next((name for flag, name in _SETS if flag in flags), machine() or "unknown")


#: Flag in /proc/cpuinfo to name.
_SETS: Final[tuple[tuple[str, str], ...]] = (("avx512f", "avx512"), ("avx2", "avx2"), ("sse4_2", "sse4.2"))
