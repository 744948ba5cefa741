"""Build long tables with planted scores, in the form that the analysis reads at the end of a run."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from valerie.analysis.rows.design import Design
from valerie.analysis.rows.table import EvaluationTable, combine
from valerie.measures import MEASURES

#: Pixels of every planted person.
_PIXELS: Final = 10_000
#: Planted factor to parameter, its type, and the step from one level to the next.
_NUMBERS: Final = {
    "x": ("scene.person-1.pos.x", "FLOAT", 3.0),
    "y": ("scene.person-1.pos.y", "FLOAT", 3.0),
    "heading": ("scene.person-1.heading", "ANGLE", 45.0),
    "sun": ("scene.sun-1.azimuth", "ANGLE", 90.0),
}
_CHARACTER: Final = "scene.person-1.character"


def planted_grid(
    values: Mapping[str, NDArray[np.float64]], factors: Mapping[str, NDArray[np.int64]]
) -> EvaluationTable:
    """Return the table of a grid on one site.

    Args:
        values: function to (N,) scores, which are clipped to 0…1 and rounded to 1/10,000.
        factors: (N,) levels of the rows in ``character``, ``camera``, and any of ``x``, ``y``, ``heading`` and ``sun``.
    """
    numbers = {name: codes for name, codes in factors.items() if name in _NUMBERS}
    camera, variant = factors["camera"], combine([*numbers.values(), factors["character"]])
    character = np.array([f"character-{k}" for k in range(factors["character"].max() + 1)])[factors["character"]]
    of_rows: dict[str, Any] = {
        "variant_index": variant,
        "frame_id": [f"planted.{v}.{c}.0" for v, c in zip(variant.tolist(), camera.tolist(), strict=True)],
        "camera": [f"camera-{c}" for c in camera.tolist()],
        "character": character,
        "distance_m": np.hypot(3.0 * factors["x"] - 2 - camera, 15 + 3.0 * factors["y"]),
        "occlusion_rate": (0.37 * factors["x"] + 0.21 * factors["y"] + 0.1 * camera) % 1,
        "pixel_area_percent": 20 / (5 + factors["y"]),
        _CHARACTER: character,
        **{path: step * numbers[name] for name, (path, _, step) in _NUMBERS.items() if name in numbers},
    }
    types = {_CHARACTER: "CATEGORICAL", **{path: kind for name, (path, kind, _) in _NUMBERS.items() if name in numbers}}
    count, repeats = len(variant), len(values)
    tp = np.concatenate([np.rint(np.clip(own, 0, 1) * _PIXELS) for own in values.values()]).astype(np.int64)
    constant = {"run_id": "planted", "sensor": "default", "instance_id": 24_001, "time_s": 0.0, "pixel_accuracy": 0.95}
    return EvaluationTable.from_columns(
        {
            **{measure.name: np.full(count * repeats, np.nan) for measure in MEASURES if measure.is_number},
            "undefined_reason": [None] * (count * repeats),
            **{name: [value] * (count * repeats) for name, value in constant.items()},
            **{name: np.tile(np.asarray(column), repeats) for name, column in of_rows.items()},
            "function": np.repeat(list(values), count),
            "tp": tp,
            "fn": _PIXELS - tp,
            "fp": np.full(count * repeats, _PIXELS // 10),
            "pacc": tp / _PIXELS,
            "precision": tp / (tp + _PIXELS // 10),
            "iou": tp / (_PIXELS + _PIXELS // 10),
        },
        types,
        {"planted": Design((("grid", int(variant.max()) + 1),), site=0)},
    )
