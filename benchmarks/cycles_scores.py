"""The quick half of Cycles' validation: what networks make of the composed frames, and the statistics of it.

Scores are kept beside the parts (``scores.jsonl``) by the network's digest: another network is scored in seconds a frame,
without Blender.
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
#: Of linear values, where errors are measured in them: the sun in chrome would outweigh the street.
_BRIGHTEST: Final = 2.0

Picture = NDArray[np.uint8]

#: Full renders of a frame, and which pictures of it are compared.
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
    """Mean, interval and the value farthest from 0; None of nothing."""
    if not values:
        return None
    found = np.asarray(values, np.float64)
    centre, largest = float(found.mean()), float(found[np.abs(found).argmax()])
    if len(found) < 2:
        return Estimate(len(found), centre, None, None, largest)
    half = float(found.std(ddof=1) / np.sqrt(len(found)) * stdtrit(len(found) - 1, 0.5 + LEVEL / 2))
    return Estimate(len(found), centre, centre - half, centre + half, largest)


def ratio(tops: Sequence[float], bottoms: Sequence[float]) -> dict[str, Any]:
    """Geometric mean of the ratios with its interval, and the largest."""
    logs = [float(np.log(top / bottom)) for top, bottom in zip(tops, bottoms, strict=True) if top > 0 and bottom > 0]
    found = estimate(logs)
    if found is None:
        return {"count": 0}
    low, high = (None if edge is None else round(float(np.exp(edge)), 4) for edge in (found.low, found.high))
    largest = round(float(np.exp(max(logs))), 4)
    return {
        "count": found.count,
        "mean": round(float(np.exp(found.mean)), 4),
        "low": low,
        "high": high,
        "largest": largest,
    }


def levels(image: LinearImage) -> Picture:
    """As functions see it: after the default sensor."""
    return develop(image.pixels, SensorSetting())


def rms(first: NDArray[Any], second: NDArray[Any], where: NDArray[np.bool_]) -> float:
    """Root mean square difference, in the values' own unit."""
    return float(np.sqrt(((first[where].astype(np.float64) - second[where].astype(np.float64)) ** 2).mean()))


def region(rectangle: Rectangle, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    found = np.zeros(shape[:2], np.bool_)
    found[rectangle.slices] = True
    return found


def pictures(parts: Parts, planned: Planned) -> dict[str, Picture]:
    """The layered frame and the full ones of the seeds that there are; each as its samples left it, and denoised."""
    background = background_key(planned.group, SAMPLES, LAYER_SEED)
    under = {"noisy": linear(parts.arrays(background)["noisy"]), "denoised": image(parts, f"{background}/denoised")}
    core = planned.core.slices
    layers = {
        "noisy": linear(parts.arrays(window_key(planned, SAMPLES, LAYER_SEED))["noisy"][core]),
        "denoised": image(parts, layer_key(planned)),
    }
    found = {
        f"layered {kind}": levels(Layer(planned.rectangle, np.ascontiguousarray(layers[kind].pixels)).over(under[kind]))
        for kind in under
    }
    for name, seed in _SEEDS.items():
        if denoised_key(planned, SAMPLES, seed) in parts:
            found[f"{name} noisy"] = levels(linear(composed(parts, planned, SAMPLES, seed).noisy))
            found[f"{name} denoised"] = levels(image(parts, denoised_key(planned, SAMPLES, seed)))
    return found


def qualities(parts: Parts, planned: Planned) -> dict[str, LinearImage]:
    """The frame at every number of samples, as these left it and denoised, and the reference."""
    found: dict[str, LinearImage] = {}
    for samples in COUNTS:
        found[f"{samples}"] = linear(composed(parts, planned, samples, LAYER_SEED).noisy)
        found[f"{samples} denoised"] = image(parts, denoised_key(planned, samples, LAYER_SEED))
    found["reference"] = linear(composed(parts, planned, REFERENCE, REFERENCE_SEED).noisy)
    return found


def image(parts: Parts, key: str) -> LinearImage:
    return LinearImage(parts.arrays(key)["pixels"])


class Scores:
    """pACC of every picture and function, in points; what was scored once is read.

    Args:
        parts: of the folder.
        folder: where they lie.
        functions: by name.
    """

    def __init__(self, parts: Parts, folder: Path, functions: dict[str, PerceptionFunction]) -> None:
        self._parts = parts
        self._lines = folder / "scores.jsonl"
        self._functions = functions
        self._known = {(r["frame"], r["picture"], r["function"]): r["pacc"] for r in read_lines(self._lines)}

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self._functions)

    def of(self, planned: Planned, names: Iterable[str], shown: Mapping[str, Picture]) -> dict[str, list[float]]:
        """Function to the pACC of each named picture; functions look only at what is not known. Empty where nobody is seen."""
        wanted = list(names)
        mask = self._parts.arrays(f"{planned.index}/person")["mask"]
        if not mask.any():
            return {}
        found: dict[str, list[float]] = {}
        for name, function in self._functions.items():
            identity = f"{function.card.digest} {function.numeric_class} {function.revision}"
            for picture in wanted:
                key = (planned.index, picture, identity)
                if key not in self._known:
                    self._known[key] = 100 * float((function.predict(shown[picture])[mask] == PERSON.train_id).mean())
                    record = {"frame": planned.index, "picture": picture, "function": identity, "name": name}
                    append_line(self._lines, {**record, "pacc": self._known[key]})
            found[name] = [self._known[planned.index, picture, identity] for picture in wanted]
        return found


def of_layers(parts: Parts, frames: Sequence[Planned], scores: Scores) -> dict[str, Any]:
    """Layer over background against the full frame: grey levels in and around the rectangle, and pACC."""
    rows: list[dict[str, Any]] = []
    for planned in (one for one in frames if layer_key(one) in parts):
        shown = pictures(parts, planned)
        row = {"frame": planned.index, **_person(parts, planned), **_differences(planned, shown)}
        names = [name for name in ("layered", *_SEEDS) if f"{name} denoised" in shown]
        for function, each in scores.of(planned, [f"{name} denoised" for name in names], shown).items():
            pacc = dict(zip(names, each, strict=True))
            row[function] = {"full": pacc["same seed"]} | {
                pair: pacc[a] - pacc[b] for pair, (a, b) in _PAIRS.items() if a in pacc and b in pacc
            }
        rows.append(row)
    found: dict[str, Any] = {"count": len(rows)}
    for kind in ("noisy", "denoised"):
        for where in ("rectangle", "around"):
            measured = [row[kind][where] for row in rows]
            twice = [m for m in measured if "seeds" in m]
            found[f"{kind} {where}"] = {
                **_by_pair(measured),
                "layer_to_seeds": ratio([m["layer"] for m in twice], [m["seeds"] for m in twice]),
            }
    for function in scores.names:
        found[function] = _by_pair([row[function] for row in rows if function in row])
    return {**found, "frames": rows}


def _by_pair(measured: Sequence[Mapping[str, float]]) -> dict[str, Any]:
    return {pair: _document([m[pair] for m in measured if pair in m]) for pair in _PAIRS}


def of_presets(parts: Parts, frames: Sequence[Planned], scores: Scores) -> dict[str, Any]:
    """Every quality against the reference, in the windows: grey levels, linear values up to `_BRIGHTEST`, pACC; and its cost."""
    chosen = [planned for planned in frames if window_key(planned, REFERENCE, REFERENCE_SEED) in parts]
    names = [f"{samples}{kind}" for samples in COUNTS for kind in ("", " denoised")]
    errors: dict[str, list[float]] = {name: [] for name in names}
    linear_errors: dict[str, list[float]] = {name: [] for name in names}
    changes: dict[str, dict[str, list[float]]] = {name: {f: [] for f in scores.names} for name in names}
    for planned in chosen:
        made = qualities(parts, planned)
        shown = {name: levels(one) for name, one in made.items()}
        values = {name: np.minimum(one.pixels.astype(np.float32), _BRIGHTEST) for name, one in made.items()}
        where = region(planned.window, shown["reference"].shape)
        for name in names:
            errors[name].append(rms(shown[name], shown["reference"], where))
            linear_errors[name].append(rms(values[name], values["reference"], where))
        for function, (reference, *each) in scores.of(planned, ("reference", *names), shown).items():
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
    """CPU seconds per megapixel: of each number of samples, and of the denoiser; over all that was made."""
    spent: dict[str, list[tuple[float, int]]] = {}
    for record in parts:
        words = record["key"].split("/")
        if "denoised" in words:
            spent.setdefault("denoiser", []).append((record["cpu_s"], record["pixels"]))
        elif "samples" in record:
            spent.setdefault(f"{words[1]} {record['samples']}", []).append((record["cpu_s"], record["pixels"]))
    return {
        kind: {
            "count": len(made),
            "cpu_s_per_megapixel": round(1e6 * sum(cpu for cpu, _ in made) / sum(pixels for _, pixels in made), 1),
        }
        for kind, made in sorted(spent.items())
    }


def _person(parts: Parts, planned: Planned) -> dict[str, Any]:
    noted = parts.figures(f"{planned.index}/person")
    return {"group": planned.group.name, "distance_m": round(noted["distance_m"], 1), "pixels": noted["pixels"]}


def _differences(planned: Planned, shown: dict[str, Picture]) -> dict[str, Any]:
    shape = shown["layered noisy"].shape
    inside = region(planned.rectangle, shape)
    places = {"rectangle": inside, "around": region(planned.window, shape) & ~inside}
    return {
        kind: {
            name: {
                pair: round(rms(shown[f"{a} {kind}"], shown[f"{b} {kind}"], where), 4)
                for pair, (a, b) in _PAIRS.items()
                if f"{b} {kind}" in shown
            }
            for name, where in places.items()
        }
        for kind in ("noisy", "denoised")
    }


def _document(values: Sequence[float]) -> dict[str, Any] | None:
    found = estimate(values)
    return None if found is None else found.document()
