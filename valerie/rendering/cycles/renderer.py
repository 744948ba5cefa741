"""The physically based engine: Blender's Cycles, a path tracer, in its own process.

`translation` has the scene and its units, `reach` the bounds of a layer, and `blender` the process.
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
        settings: quality of the images; the default settings if None.
        holder: the Blender to use; this process's own if None.

    Raises:
        MissingDependency: there is no Blender environment (``make cycles`` installs it).
    """

    name: ClassVar[str] = "cycles"
    revision: ClassVar[int] = 10

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
        """CPU seconds that Blender has used so far for this process."""
        return self._holder.cpu_seconds

    def background(self, scene: Scene, view: View) -> LinearImage:
        """Render the frame without movables.

        Raises:
            RenderingError: the image is constant or not finite.
        """
        return LinearImage(self._whole(scene, view, movables=False))

    def layer(self, scene: Scene, view: View) -> Layer:
        """Render the rectangle that movables change noticeably. The layer is empty if they change nothing."""
        rectangle = reached_rectangle(scene, view)
        if rectangle.empty:
            return Layer(rectangle, np.zeros((0, 0, 3), np.float16))
        # The denoiser uses the surroundings of a pixel. They are rendered too, and cropped afterwards.
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
        """Do nothing: all instances in a process share Blender, which ends with the process."""

    def _whole(self, scene: Scene, view: View, *, movables: bool) -> NDArray[np.float16]:
        pixels = self._render(scene, view, None, movables=movables)
        require_image(pixels, engine=self.name)
        return pixels

    def _render(self, scene: Scene, view: View, border: Rectangle | None, *, movables: bool) -> NDArray[np.float16]:
        pixels = translation.render(self._holder.get(), scene, view, self._settings, border=border, movables=movables)
        return np.clip(pixels, 0.0, _BRIGHTEST).astype(np.float16)


def numeric_class(version: str, device: str, device_name: str) -> str:
    """Return the numeric class, e.g. ``bpy-4.5.15-cpu-avx2`` or ``bpy-4.5.15-optix-nvidia-l4``.

    Cycles and its denoiser have separate code for each kind of device. Settings such as the samples are not part of the class.
    Neither is the number of threads, which changes no bit.
    """
    kind = _instruction_set() if device == "CPU" else device_name
    return re.sub(r"[^a-z0-9.]+", "-", f"bpy {version.removesuffix(' LTS')} {device} {kind}".lower()).strip("-")


def _instruction_set() -> str:
    """Return the widest instruction set of this CPU for which Cycles or its denoiser has separate code."""
    try:
        lines = Path("/proc/cpuinfo").read_text("ascii", "replace").splitlines()
    except OSError:  # not Linux
        lines = []
    flags = next((set(line.partition(":")[2].split()) for line in lines if line.startswith("flags")), set())
    return next((name for flag, name in _SETS if flag in flags), machine() or "unknown")


#: Flags in /proc/cpuinfo with the names of their instruction sets, widest first.
_SETS: Final[tuple[tuple[str, str], ...]] = (("avx512f", "avx512"), ("avx2", "avx2"), ("sse4_2", "sse4.2"))
