"""Measure the calibration of perception-error models on planted truth.

``make bench-error-model``, or ``python -m benchmarks.bench_error_model [--repetitions N]``. Persons stand at places of a
grid; each place has its own difficulty, which no column shows. The *true* error compares a model with the known
probability of a miss at 4,000 other places; the *held-out* error is the one that users see, and *known* the one that the
check would show of the known probabilities themselves: chance alone. *Files* counts the models that are
exported, *below 2 %* those of them whose true error is at most 2 %. *Bound* is the share of all models whose true error is at
most the stated bound for new places.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, logit, ndtr

from benchmarks import results
from tests.planted_tables import planted_table
from valerie.analysis.error_model.model import LEVELS, LIMIT, fit_error_models
from valerie.analysis.rows.design import Design
from valerie.statistics.calibration import calibration, quantile_shares

Floats = NDArray[np.float64]
#: Standard deviation of the rows of one place, in logits.
_WITHIN: Final = 1.2
_PERSONS: Final = 24

#: Name to the mean logit at (distance, occlusion, area, contrast) and the standard deviation between places.
WORLDS: Final[dict[str, tuple[Callable[[Floats], Floats], float]]] = {
    "smooth": (lambda x: 4 - 0.13 * x[:, 0] - 4 * x[:, 1] + 3 * np.abs(x[:, 3]), 0.5),
    "smooth, places differ": (lambda x: 4 - 0.13 * x[:, 0] - 4 * x[:, 1] + 3 * np.abs(x[:, 3]), 1.2),
    "interaction": (lambda x: 3 - 0.004 * x[:, 0] ** 2 * (0.3 + 1.5 * x[:, 1]) + 2 * np.sin(5 * x[:, 3]), 0.5),
    "cliff": (lambda x: 2.5 - 5 * ((x[:, 1] > 0.4) & (x[:, 0] > 18)) - 0.03 * x[:, 0], 0.5),
}


def persons(world: str, places: int, rng: np.random.Generator) -> tuple[Floats, Floats, NDArray[np.int64], Floats]:
    """Return columns, pACC, place and true probability of a miss of each person."""
    mean, deviation = WORLDS[world]
    place = np.repeat(np.arange(places), _PERSONS)
    distance, occlusion = rng.uniform(5, 40, places)[place], rng.beta(0.6, 2, places)[place]
    distance = distance + rng.normal(0, 0.6, len(place))
    occlusion = np.clip(occlusion + rng.normal(0, 0.05, len(place)), 0, 1)
    x = np.column_stack((distance, occlusion, 60 / distance**2 * (1 - occlusion), rng.uniform(-0.6, 0.6, len(place))))
    noise = rng.normal(0, deviation, places)[place] + rng.normal(0, _WITHIN, len(place))
    centre = mean(x)
    pacc = np.round(np.clip(1.15 * expit(centre + noise) - 0.08, 0, 1), 3)  # piled at 0 and 1
    miss = ndtr((logit((0.5 - 0.0005 + 0.08) / 1.15) - centre) / np.hypot(deviation, _WITHIN))
    return x, np.asarray(pacc, np.float64), place.astype(np.int64), np.asarray(miss, np.float64)


def measure(world: str, places: int, repetitions: int) -> dict[str, Any]:
    """Return one row of the table."""
    fresh, fresh_pacc, _, truth = persons(world, 4_000, np.random.default_rng(99))
    held_out, known, true, bound, quantiles, inside, files = [], [], [], [], [], [], []
    for repetition in range(repetitions):
        x, pacc, place, own = persons(world, places, np.random.default_rng([places, repetition]))
        table = planted_table(
            pacc,
            place,
            design=Design((("grid", places),)),
            distance_m=x[:, 0],
            occlusion_rate=x[:, 1],
            pixel_area_percent=x[:, 2],
            contrast=x[:, 3],
        )
        fitted = fit_error_models(table, seed=repetition)
        if not fitted.models:
            continue
        (model,) = fitted.models
        answer = model.predict(fresh)
        rows = answer.inside
        compared = calibration(answer.miss[rows], truth[rows], np.zeros(int(rows.sum()), np.int64))
        shares = quantile_shares(answer.below[rows], model.fit.bounds, fresh_pacc[rows], LEVELS)
        held_out.append(model.misses.error)
        known.append(calibration(own, pacc < model.threshold, place).error)
        true.append(compared.error)
        bound.append(model.misses.on_new_places)
        quantiles.append(float(np.abs(np.subtract(shares, LEVELS)).mean()))
        inside.append(float(rows.mean()))
        files.append(model.usable)
    given_out = np.array(files, bool)
    count = len(true)
    return {
        "world": world,
        "places": places,
        "fitted": count,
        "held-out": float(np.mean(held_out)) if count else None,
        "known": float(np.mean(known)) if count else None,
        "true": float(np.mean(true)) if count else None,
        "worst": float(np.max(true)) if count else None,
        "bound": float(np.mean(np.array(true) <= np.array(bound))) if count else None,
        "quantiles": float(np.mean(quantiles)) if count else None,
        "inside": float(np.mean(inside)) if count else None,
        "files": int(given_out.sum()),
        "below 2 %": int((given_out & (np.array(true) <= LIMIT)).sum()) if count else 0,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repetitions", type=int, default=40)
    parser.add_argument("--places", type=int, nargs="+", default=[20, 60, 160, 400, 1000])
    arguments = parser.parse_args()
    rows = []
    print(
        "| World | Places | Fitted | Held-out | Known | True | Worst | Bound holds | Quantiles | Inside | Files | below 2 % |"
    )
    print("|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|")
    for world in WORLDS:
        for places in arguments.places:
            row = measure(world, places, arguments.repetitions)
            rows.append(row)
            cells = [f"{100 * value:.1f}" if isinstance(value, float) else "–" if value is None else str(value)
                     for value in row.values()]  # fmt: skip
            print(f"| {' | '.join(cells)} |", flush=True)
    results.write("error_model", {"repetitions": arguments.repetitions, "rows": rows})


if __name__ == "__main__":
    main()
