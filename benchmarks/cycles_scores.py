"""Score networks on the composed frames and compute the statistics, the quick half of Cycles' validation.

``scores.jsonl``, next to the parts, keeps the scores by the network's digest. Scoring another network takes seconds per frame
and no Blender.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from benchmarks.cycles_frames import Planned, linear
from benchmarks.cycles_parts import Parts, append_line, read_lines
from benchmarks.cycles_render import (
    COUNTS,
    FULL_SEED,
    LAYER_SEED,
    REFERENCE,
    REFERENCE_SEED,
    SAMPLES,
    background_key,
    composed,
    denoised_key,
    layer_key,
    window_key,
)
from valerie.labels import PERSON
from valerie.perception.base import PerceptionFunction
from valerie.rendering.base import Layer, LinearImage, Rectangle
from valerie.sensing.sensor import develop
from valerie.sensing.settings import SensorSetting

LEVEL: Final = 0.9
#: Clipping limit of linear values for errors: reflections of the sun in chrome would outweigh the street.
_BRIGHTEST: Final = 2.0

Picture = NDArray[np.uint8]

#: Seeds of a frame's full renders, and pairs of its pictures to compare.
_SEEDS: Final = {"same seed": LAYER_SEED, "other seed": FULL_SEED}
_PAIRS: Final = {
    "layer": ("layered", "other seed"),
    "seeds": ("same seed", "other seed"),
    "layer_same_seed": ("layered", "same seed"),
}


@dataclass(frozen=True, slots=True)
class Estimate:
    """A mean with Student's interval of `LEVEL`; the interval is empty (None) for fewer than two values."""

    count: int
    mean: float
    low: float | None
    high: float | None
    largest: float

    def document(self) -> dict[str, Any]:
        return {name: round(value, 3) if isinstance(value, float) else value for name, value in asdict(self).items()}


def estimate(values: Sequence[float]) -> Estimate | None:
    """Return mean, interval and the value farthest from 0; None without values."""
    if not values:
        return None
    numbers = np.asarray(values, np.float64)
    centre, largest = float(numbers.mean()), float(numbers[np.abs(numbers).argmax()])
    if len(numbers) < 2:
        return Estimate(len(numbers), centre, None, None, largest)
    half = float(numbers.std(ddof=1) / np.sqrt(len(numbers)) * stdtrit(len(numbers) - 1, 0.5 + LEVEL / 2))
    return Estimate(len(numbers), centre, centre - half, centre + half, largest)


def ratio(tops: Sequence[float], bottoms: Sequence[float]) -> dict[str, Any]:
    """Return the geometric mean of the ratios with its interval, and the largest ratio."""
    logs = [float(np.log(top / bottom)) for top, bottom in zip(tops, bottoms, strict=True) if top > 0 and bottom > 0]
    logarithm = estimate(logs)
    if logarithm is None:
        return {"count": 0}
    low, high = (None if edge is None else round(float(np.exp(edge)), 4) for edge in (logarithm.low, logarithm.high))
    largest = round(float(np.exp(max(logs))), 4)
    return {
        "count": logarithm.count,
        "mean": round(float(np.exp(logarithm.mean)), 4),
        "low": low,
        "high": high,
        "largest": largest,
    }


def levels(image: LinearImage) -> Picture:
    """Return the picture after the default sensor, as functions see it."""
    return develop(image.pixels, SensorSetting())


def rms(first: NDArray[Any], second: NDArray[Any], where: NDArray[np.bool_]) -> float:
    """Return the root mean square difference, in the values' unit."""
    return float(np.sqrt(((first[where].astype(np.float64) - second[where].astype(np.float64)) ** 2).mean()))


def region(rectangle: Rectangle, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    mask = np.zeros(shape[:2], np.bool_)
    mask[rectangle.slices] = True
    return mask


def pictures(parts: Parts, planned: Planned) -> dict[str, Picture]:
    """Return the frame of layer and background, and the full frames of all rendered seeds, each noisy and denoised."""
    background = background_key(planned.group, SAMPLES, LAYER_SEED)
    under = {"noisy": linear(parts.arrays(background)["noisy"]), "denoised": image(parts, f"{background}/denoised")}
    core = planned.core.slices
    layers = {
        "noisy": linear(parts.arrays(window_key(planned, SAMPLES, LAYER_SEED))["noisy"][core]),
        "denoised": image(parts, layer_key(planned)),
    }
    images = {
        f"layered {kind}": levels(Layer(planned.rectangle, np.ascontiguousarray(layers[kind].pixels)).over(under[kind]))
        for kind in under
    }
    for name, seed in _SEEDS.items():
        if denoised_key(planned, SAMPLES, seed) in parts:
            images[f"{name} noisy"] = levels(linear(composed(parts, planned, SAMPLES, seed).noisy))
            images[f"{name} denoised"] = levels(image(parts, denoised_key(planned, SAMPLES, seed)))
    return images


def qualities(parts: Parts, planned: Planned) -> dict[str, LinearImage]:
    """Return the frame at every number of samples, noisy and denoised, and the reference."""
    images: dict[str, LinearImage] = {}
    for samples in COUNTS:
        images[f"{samples}"] = linear(composed(parts, planned, samples, LAYER_SEED).noisy)
        images[f"{samples} denoised"] = image(parts, denoised_key(planned, samples, LAYER_SEED))
    images["reference"] = linear(composed(parts, planned, REFERENCE, REFERENCE_SEED).noisy)
    return images


def image(parts: Parts, key: str) -> LinearImage:
    return LinearImage(parts.arrays(key)["pixels"])


class Scores:
    """Cache of the pACC of every picture and function, in percentage points.

    Args:
        parts: the parts.
        folder: the parts' folder.
        functions: name to function.
    """

    def __init__(self, parts: Parts, folder: Path, functions: dict[str, PerceptionFunction]) -> None:
        self._parts = parts
        self._lines = folder / "scores.jsonl"
        self._functions = functions
        self._known = {(r["frame"], r["picture"], r["function"]): r["pacc"] for r in read_lines(self._lines)}

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self._functions)

    def of(self, planned: Planned, names: Iterable[str], images: Mapping[str, Picture]) -> dict[str, list[float]]:
        """Return the pACC of each named picture by function; empty if no person is visible. Only new pictures are predicted."""
        pictures = list(names)
        mask = self._parts.arrays(f"{planned.index}/person")["mask"]
        if not mask.any():
            return {}
        scores: dict[str, list[float]] = {}
        for name, function in self._functions.items():
            identity = f"{function.card.digest} {function.numeric_class} {function.revision}"
            for picture in pictures:
                key = (planned.index, picture, identity)
                if key not in self._known:
                    self._known[key] = 100 * float((function.predict(images[picture])[mask] == PERSON.train_id).mean())
                    record = {"frame": planned.index, "picture": picture, "function": identity, "name": name}
                    append_line(self._lines, {**record, "pacc": self._known[key]})
            scores[name] = [self._known[planned.index, picture, identity] for picture in pictures]
        return scores


def of_layers(parts: Parts, frames: Sequence[Planned], scores: Scores) -> dict[str, Any]:
    """Compare the layer over the background with the full frame: grey levels in and around the rectangle, and pACC."""
    rows: list[dict[str, Any]] = []
    for planned in (frame for frame in frames if layer_key(frame) in parts):
        images = pictures(parts, planned)
        row = {"frame": planned.index, **_person(parts, planned), **_differences(planned, images)}
        names = [name for name in ("layered", *_SEEDS) if f"{name} denoised" in images]
        for function, each in scores.of(planned, [f"{name} denoised" for name in names], images).items():
            pacc = dict(zip(names, each, strict=True))
            row[function] = {"full": pacc["same seed"]} | {
                pair: pacc[a] - pacc[b] for pair, (a, b) in _PAIRS.items() if a in pacc and b in pacc
            }
        rows.append(row)
    statistics: dict[str, Any] = {"count": len(rows)}
    for kind in ("noisy", "denoised"):
        for where in ("rectangle", "around"):
            measured = [row[kind][where] for row in rows]
            twice = [m for m in measured if "seeds" in m]
            statistics[f"{kind} {where}"] = {
                **_by_pair(measured),
                "layer_to_seeds": ratio([m["layer"] for m in twice], [m["seeds"] for m in twice]),
            }
    for function in scores.names:
        statistics[function] = _by_pair([row[function] for row in rows if function in row])
    return {**statistics, "frames": rows}


def _by_pair(measured: Sequence[Mapping[str, float]]) -> dict[str, Any]:
    return {pair: _document([m[pair] for m in measured if pair in m]) for pair in _PAIRS}


def of_presets(parts: Parts, frames: Sequence[Planned], scores: Scores) -> dict[str, Any]:
    """Compare every quality with the reference in the windows: grey levels, linear values up to `_BRIGHTEST`, pACC and cost."""
    chosen = [planned for planned in frames if window_key(planned, REFERENCE, REFERENCE_SEED) in parts]
    names = [f"{samples}{kind}" for samples in COUNTS for kind in ("", " denoised")]
    errors: dict[str, list[float]] = {name: [] for name in names}
    linear_errors: dict[str, list[float]] = {name: [] for name in names}
    changes: dict[str, dict[str, list[float]]] = {name: {f: [] for f in scores.names} for name in names}
    for planned in chosen:
        renders = qualities(parts, planned)
        images = {name: levels(render) for name, render in renders.items()}
        values = {name: np.minimum(render.pixels.astype(np.float32), _BRIGHTEST) for name, render in renders.items()}
        where = region(planned.window, images["reference"].shape)
        for name in names:
            errors[name].append(rms(images[name], images["reference"], where))
            linear_errors[name].append(rms(values[name], values["reference"], where))
        for function, (reference, *each) in scores.of(planned, ("reference", *names), images).items():
            for name, pacc in zip(names, each, strict=True):
                changes[name][function].append(pacc - reference)
    rows = {
        name: {
            "rmse_grey_levels": _document(errors[name]),
            "rmse_linear": _document(linear_errors[name]),
            **{f: _document(v) for f, v in changes[name].items()},
        }
        for name in names
    }
    return {"count": len(chosen), "frames": [planned.index for planned in chosen], "rows": rows, "cost": cost(parts)}


def cost(parts: Parts) -> dict[str, Any]:
    """Return the CPU seconds per megapixel, by number of samples and for the denoiser, over all parts."""
    spent: dict[str, list[tuple[float, int]]] = {}
    for record in parts:
        words = record["key"].split("/")
        if "denoised" in words:
            spent.setdefault("denoiser", []).append((record["cpu_s"], record["pixels"]))
        elif "samples" in record:
            spent.setdefault(f"{words[1]} {record['samples']}", []).append((record["cpu_s"], record["pixels"]))
    return {
        kind: {
            "count": len(records),
            "cpu_s_per_megapixel": round(
                1e6 * sum(cpu for cpu, _ in records) / sum(pixels for _, pixels in records), 1
            ),
        }
        for kind, records in sorted(spent.items())
    }


def _person(parts: Parts, planned: Planned) -> dict[str, Any]:
    noted = parts.figures(f"{planned.index}/person")
    return {"group": planned.group.name, "distance_m": round(noted["distance_m"], 1), "pixels": noted["pixels"]}


def _differences(planned: Planned, images: dict[str, Picture]) -> dict[str, Any]:
    shape = images["layered noisy"].shape
    inside = region(planned.rectangle, shape)
    places = {"rectangle": inside, "around": region(planned.window, shape) & ~inside}
    return {
        kind: {
            name: {
                pair: round(rms(images[f"{a} {kind}"], images[f"{b} {kind}"], where), 4)
                for pair, (a, b) in _PAIRS.items()
                if f"{b} {kind}" in images
            }
            for name, where in places.items()
        }
        for kind in ("noisy", "denoised")
    }


def _document(values: Sequence[float]) -> dict[str, Any] | None:
    result = estimate(values)
    return None if result is None else result.document()
