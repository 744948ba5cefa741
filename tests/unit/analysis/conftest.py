"""A synthetic run with known results: a pedestrian in a street, three cameras, several functions."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pytest

from valerie.analysis.rows.design import Design
from valerie.analysis.rows.table import EvaluationTable
from valerie.measures import MEASURES

PARAMETERS = {
    "scene.person-1.pos.x": "FLOAT",
    "scene.person-1.pos.y": "FLOAT",
    "scene.person-1.character": "CATEGORICAL",
}
#: A grid of any size on one site.
GRID = {"run-1": Design((("grid", 10_000_000),), site=0)}
CHARACTERS = ("black-outfit", "yellow-shirt")
CAMERAS = {"camera-1": 0.0, "camera-2": 1.5, "camera-3": 3.0}

#: (function, character, distance, occlusion, standard normal noise) → pACC before clipping.
Law = Callable[[str, str, float, float, float], float]


def synthetic_rows(
    law: Law,
    *,
    xs: Sequence[float],
    ys: Sequence[float],
    functions: Sequence[str] = ("a-net", "b-net"),
    characters: Sequence[str] = CHARACTERS,
    false_positives: int = 100,
    seed: int = 0,
) -> list[dict[str, object]]:
    """Return rows of a full grid; one part of the noise is per place, one per frame and function."""
    generator = np.random.default_rng(seed)
    rows: list[dict[str, object]] = []
    variant = -1
    for x in xs:
        for y in ys:
            place = generator.standard_normal()
            occlusion = float(np.clip(generator.uniform(-0.6, 0.8), 0, 1))
            for character in characters:
                variant += 1
                for number, (camera, offset) in enumerate(CAMERAS.items()):
                    distance = float(np.hypot(x - offset, y + 12))
                    amodal = int(500_000 / distance**2)
                    area = round(amodal * (1 - occlusion))
                    for function in functions:
                        noise = (place + generator.standard_normal()) / np.sqrt(2)
                        pacc = float(np.clip(law(function, character, distance, occlusion, noise), 0, 1))
                        tp = round(pacc * area)
                        called = tp + false_positives
                        rows.append(
                            {
                                **dict.fromkeys(measure.name for measure in MEASURES),
                                "run_id": "run-1",
                                "variant_index": variant,
                                "frame_id": f"{variant:06d}-{number}",
                                "camera": camera,
                                "time_s": 0.0,
                                "character": character,
                                "sensor": "default",
                                "function": function,
                                "instance_id": 24001,
                                "pixel_area": area,
                                "pixel_area_percent": 100 * area / (960 * 540),
                                "pixel_area_amodal": amodal,
                                "occlusion_rate": occlusion,
                                "truncation_rate": 0.0,
                                "distance_m": distance,
                                "depth_m": y + 12,
                                "bearing_deg": 0.0,
                                "aspect_deg": 180.0,
                                "sun_azimuth_deg": 180.0,
                                "sun_elevation_deg": 40.0,
                                "road_friction": 0.85,
                                "tp": tp,
                                "fn": area - tp,
                                "pacc": tp / area if area else None,
                                "undefined_reason": None if area else "fully hidden",
                                "precision": tp / called if called else None,
                                "iou": tp / (area + false_positives) if area + false_positives else None,
                                "pixel_accuracy": 0.97,
                                "fp": false_positives,
                                "scene.person-1.pos.x": float(x),
                                "scene.person-1.pos.y": float(y),
                                "scene.person-1.character": character,
                            }
                        )
    return rows


@pytest.fixture
def synthetic() -> Callable[..., list[dict[str, object]]]:
    """`synthetic_rows`, which returns rows of a run whose pACC follows a law."""
    return synthetic_rows


@pytest.fixture(scope="session")
def synthetic_table() -> Callable[..., EvaluationTable]:
    """A function that returns the table of `synthetic_rows`."""

    def build(law: Law, **more: object) -> EvaluationTable:
        return EvaluationTable.from_rows(synthetic_rows(law, **more), PARAMETERS, GRID)  # type: ignore[arg-type]

    return build


@pytest.fixture
def parameters() -> dict[str, str]:
    """The varied parameters of the synthetic rows."""
    return dict(PARAMETERS)


@pytest.fixture
def grid() -> dict[str, Design]:
    """The design of synthetic rows: all of them listed."""
    return dict(GRID)


@pytest.fixture(scope="session")
def dropping_table() -> EvaluationTable:
    """150 places; a-net sees 0.9 up to 30 m, 0.5 beyond; b-net sees 0.7 (black outfit) or 0.8 (yellow shirt)."""

    def law(function: str, character: str, distance: float, _occlusion: float, noise: float) -> float:
        if function == "a-net":
            return (0.9 if distance < 30 else 0.5) + 0.03 * noise
        return (0.7 if character == "black-outfit" else 0.8) + 0.03 * noise

    rows = synthetic_rows(law, xs=np.linspace(-2, 7, 10).tolist(), ys=np.linspace(5, 33, 15).tolist())
    return EvaluationTable.from_rows(rows, PARAMETERS, GRID)
