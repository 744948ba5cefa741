"""Render windows and backgrounds into a folder, the slow half of Cycles' validation; partial results are useful."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.cycles_frames import Group, Planned, cut, linear, mean, put
from benchmarks.cycles_parts import Parts
from valerie.labels import PERSON
from valerie.rendering.base import Rectangle
from valerie.rendering.cycles import translation
from valerie.rendering.cycles.blender import BlenderHolder
from valerie.rendering.cycles.renderer import CyclesRenderer
from valerie.rendering.cycles.settings import PRESETS, CyclesSettings
from valerie.rendering.cycles.translation import Guided
from valerie.rendering.ground_truth import TruthPass

#: Samples of the preset ``standard``, the engine's default.
SAMPLES: Final = PRESETS["standard"].samples
#: Seeds of the layer and its background, of the full frame for comparison, and of the presets' reference.
LAYER_SEED, FULL_SEED, REFERENCE_SEED = 0, 1, 9
#: Samples of the presets, compared with `REFERENCE`.
COUNTS: Final = (16, 64, 256)
REFERENCE: Final = PRESETS["paper"].samples
#: Number of frames whose layer the engine also renders, to check that a window's crop equals the engine's layer.
CHECKED: Final = 2
#: Light paths between two stored states: about a minute of one core.
STRIP: Final = 6_000_000
_PERSON: Final = PERSON.id


class Studio:
    """Renderer of the parts that a folder lacks.

    Args:
        parts: the folder's parts.
        holder: holder of the Blender process.
        say: prints a line about each new part.
        strip: light paths between two stored states.
    """

    def __init__(
        self, parts: Parts, holder: BlenderHolder, say: Callable[[str], None] = print, *, strip: int = STRIP
    ) -> None:
        self._parts = parts
        self._holder = holder
        self._say = say
        self._strip = strip
        self._truth: TruthPass | None = None
        self._made = 0

    def frame(self, planned: Planned, *, other_seed: bool = True) -> bool:
        """Render all parts that are needed to judge one frame's layer, optionally with a full render of another seed.

        Returns:
            True if any part was missing.
        """
        before = self._made
        for seed in (LAYER_SEED, FULL_SEED) if other_seed else (LAYER_SEED,):
            self._window(planned, SAMPLES, seed)
            self._clean(planned, SAMPLES, seed)
        background = background_key(planned.group, SAMPLES, LAYER_SEED)
        self._make(f"{background}/denoised", lambda: self._denoised(part(self._parts, background)))
        window = window_key(planned, SAMPLES, LAYER_SEED)
        self._make(layer_key(planned), lambda: self._layer(part(self._parts, window), planned.core))
        if planned.index < CHECKED:
            self._check(planned)
        return self._made > before

    def presets(self, planned: Planned) -> bool:
        """Render one pedestrian at every quality and as the reference; return True if any part was missing."""
        before = self._made
        for samples in COUNTS:
            self._window(planned, samples, LAYER_SEED)
            self._clean(planned, samples, LAYER_SEED)
        self._window(planned, REFERENCE, REFERENCE_SEED)
        return self._made > before

    def _clean(self, planned: Planned, samples: int, seed: int) -> None:
        key = denoised_key(planned, samples, seed)
        self._make(key, lambda: self._denoised(composed(self._parts, planned, samples, seed)))

    def _window(self, planned: Planned, samples: int, seed: int) -> None:
        """Render the window and the backgrounds around it."""
        for key, count, number in around(planned.group, samples, seed):
            whole = Rectangle(0, 0, planned.view.width, planned.view.height)
            self._render(key, planned, whole, count, number, movables=False)
        truth = f"{planned.index}/person"
        if truth not in self._parts:
            self._truth = self._truth or TruthPass()
            persons = self._truth.truth(planned.scene, planned.view).class_map == _PERSON
            self._parts.add(truth, {"mask": persons}, pixels=int(persons.sum()), distance_m=planned.distance_m)
        key = window_key(planned, samples, seed)
        self._render(key, planned, planned.window, samples, seed, movables=True)

    def _check(self, planned: Planned) -> None:
        """Record two differences, at the comparison's resolution, that must be 0 for the method to be valid.

        ``border``: the background rendered inside a border, against the same pixels of the whole one. ``layer``: the engine's own
        layer against the denoised crop of the window, as float16.
        """
        key = f"{planned.index}/checks"
        if key in self._parts:
            return
        whole = part(self._parts, background_key(planned.group, SAMPLES, LAYER_SEED))
        settings = _settings(SAMPLES, LAYER_SEED)
        bordered = translation.guided(
            self._holder.get(), planned.scene, planned.view, settings, border=planned.window, movables=False
        )
        border = max(float(np.abs(a - b).max()) for a, b in zip(cut(whole, planned.window), bordered, strict=True))
        engine = CyclesRenderer(CyclesSettings(seed=LAYER_SEED), self._holder)
        before = self._holder.cpu_seconds
        layer = engine.layer(planned.scene, planned.view)
        cost = self._holder.cpu_seconds - before
        own = self._parts.arrays(layer_key(planned))["pixels"]
        apart = np.abs(layer.pixels.astype(np.float32) - own.astype(np.float32))
        figures = {
            "border": border,
            "layer": float(apart.max()),
            "layer_pixels_that_differ": int((apart > 0).any(axis=2).sum()),
            "layer_cpu_s": round(cost, 2),
        }
        self._parts.add(key, {}, **figures)
        self._say(f"{key}: {figures}")

    def _render(self, key: str, planned: Planned, where: Rectangle, samples: int, seed: int, *, movables: bool) -> None:
        """Render a rectangle, strip by strip if it is large, so that an interruption loses at most one strip."""
        if key in self._parts:
            return
        settings, strips = _settings(samples, seed), list(strips_of(where, samples, self._strip))
        for number, strip in enumerate(strips):

            def rendered(strip: Rectangle = strip) -> dict[str, NDArray[Any]]:
                blender = self._holder.get()
                result = translation.guided(
                    blender, planned.scene, planned.view, settings, border=strip, movables=movables
                )
                return dict(result._asdict())

            self._make(f"{key}/strip/{number}", rendered)
        keys = [f"{key}/strip/{number}" for number in range(len(strips))]
        joined = {name: np.concatenate([self._parts.arrays(strip)[name] for strip in keys]) for name in Guided._fields}
        spent = sum(self._parts.figures(strip)["cpu_s"] for strip in keys)
        self._parts.add(key, joined, cpu_s=round(spent, 2), samples=samples, pixels=where.width * where.height)
        self._parts.remove_arrays(keys)

    def _make(self, key: str, make: Callable[[], dict[str, NDArray[Any]]]) -> None:
        if key in self._parts:
            return
        before, start = self._holder.cpu_seconds, time.monotonic()
        arrays = make()
        height, width, _ = next(iter(arrays.values())).shape
        spent, passed = self._holder.cpu_seconds - before, time.monotonic() - start
        self._parts.add(key, arrays, cpu_s=round(spent, 2), wall_s=round(passed, 1), pixels=width * height)
        self._made += 1
        self._say(f"{key}: {width} x {height} pixels, {spent:.1f} CPU s in {passed:.0f} s")

    def _denoised(self, frame: Guided) -> dict[str, NDArray[Any]]:
        return {"pixels": linear(translation.denoised(self._holder.get(), frame)).pixels}

    def _layer(self, window: Guided, core: Rectangle) -> dict[str, NDArray[Any]]:
        """Return a layer made like the engine's: denoised with the pixels around it, then cropped."""
        return {"pixels": np.ascontiguousarray(self._denoised(window)["pixels"][core.slices])}


def strips_of(where: Rectangle, samples: int, paths: int = STRIP) -> Iterator[Rectangle]:
    """Yield full-width parts of a rectangle, from top to bottom, of about ``paths`` light paths each."""
    count = min(max(round(where.width * where.height * samples / paths), 1), where.height)
    rows = [where.y + where.height * number // count for number in range(count + 1)]
    for top, bottom in pairwise(rows):
        yield Rectangle(where.x, top, where.width, bottom - top)


def around(group: Group, samples: int, seed: int) -> Iterator[tuple[str, int, int]]:
    """Yield (key, samples, seed) of the backgrounds that surround a window.

    A window of up to `SAMPLES` samples gets a background with as many. A window of more samples gets the mean of two backgrounds
    of `SAMPLES` each with different seeds, which looks the same at a fraction of the cost.
    """
    seeds = (LAYER_SEED, FULL_SEED) if samples > SAMPLES else (seed,)
    for number in seeds:
        count = min(samples, SAMPLES)
        yield background_key(group, count, number), count, number


def composed(parts: Parts, planned: Planned, samples: int, seed: int) -> Guided:
    """Return the noisy whole frame."""
    layers = [part(parts, key) for key, _, _ in around(planned.group, samples, seed)]
    background = layers[0] if len(layers) == 1 else mean(*layers)
    return put(part(parts, window_key(planned, samples, seed)), planned.window, background)


def part(parts: Parts, key: str) -> Guided:
    return Guided(**parts.arrays(key))


def background_key(group: Group, samples: int, seed: int) -> str:
    return f"{group.name}/background/{samples}/{seed}"


def window_key(planned: Planned, samples: int, seed: int) -> str:
    return f"{planned.index}/window/{samples}/{seed}"


def denoised_key(planned: Planned, samples: int, seed: int) -> str:
    return f"{planned.index}/denoised/{samples}/{seed}"


def layer_key(planned: Planned) -> str:
    return f"{planned.index}/layer"


def _settings(samples: int, seed: int) -> dict[str, Any]:
    return CyclesSettings(samples=samples, seed=seed, denoise=False).inputs()
