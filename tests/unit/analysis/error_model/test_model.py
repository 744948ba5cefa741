"""Perception-error models on planted persons whose true probability of a miss is known."""

from __future__ import annotations

import json
from collections.abc import Callable
from io import BytesIO
from typing import Any

import numpy as np
import onnxruntime
import pyarrow.parquet
import pytest
from scipy.special import ndtr
from scipy.stats import norm

from tests.planted_tables import planted_table
from valerie.analysis.error_model.files import CARD, error_model_files
from valerie.analysis.error_model.model import LEVELS, LIMIT, ErrorModel, ErrorModels, fit_error_models
from valerie.analysis.error_model.onnx_export import to_onnx
from valerie.analysis.rows.design import Design
from valerie.analysis.rows.table import EvaluationTable
from valerie.errors import InvalidInput
from valerie.statistics.calibration import calibration

NAMES = ("distance_m", "occlusion_rate")


def centre(distance: Any, occlusion: Any) -> Any:
    return 1.1 - 0.02 * distance - 0.4 * occlusion


def table(
    places: int, *, persons: int = 6, mean: Callable[..., Any] = centre, noise: float = 0.2, **more: Any
) -> EvaluationTable:
    """Persons whose pACC depends on distance and occlusion, with normal noise."""
    rng = np.random.default_rng(places)
    place = np.repeat(np.arange(places), persons)
    distance, occlusion = rng.uniform(5, 40, len(place)), rng.uniform(0, 0.8, len(place))
    pacc = np.clip(mean(distance, occlusion) + rng.normal(0, noise, len(place)), 0, 1)
    design = Design((("grid", places),))
    return planted_table(pacc, place, design=design, distance_m=distance, occlusion_rate=occlusion, **more)


@pytest.fixture(scope="module")
def models() -> ErrorModels:
    return fit_error_models(table(600), given=(*NAMES, "contrast", "pixel_area_percent"))


@pytest.fixture(scope="module")
def model(models: ErrorModels) -> ErrorModel:
    return models.models[0]


def beyond(distance: Any, occlusion: Any) -> Any:
    """Return a mean pACC that falls at an edge in two columns."""
    return 0.9 - 0.8 * ((occlusion > 0.4) & (distance > 18))


@pytest.fixture(scope="module")
def bent() -> ErrorModels:
    return fit_error_models(table(400, mean=beyond, noise=0.3), given=NAMES)


def files_of(models: ErrorModels) -> dict[str, bytes]:
    return error_model_files(models, run="r1", table="ab", threshold=0.5, conditions={"asset": "planted"})


def test_answers_are_those_of_the_planted_truth(models: ErrorModels, model: ErrorModel) -> None:
    assert model.columns == NAMES
    assert set(models.left_out) == {"contrast", "pixel_area_percent"}
    distance, occlusion = np.meshgrid(np.linspace(7, 38, 8), np.linspace(0.05, 0.75, 8))
    queries = np.column_stack((distance.ravel(), occlusion.ravel()))
    answer = model.predict(queries)
    middle = centre(*queries.T)
    assert answer.inside.all()
    assert answer.miss == pytest.approx(ndtr((0.5 - middle) / 0.2), abs=0.12)
    assert np.abs(answer.miss - ndtr((0.5 - middle) / 0.2)).mean() < 0.03
    expected = np.clip(middle[:, None] + norm.ppf(LEVELS) * 0.2, 0, 1)
    assert np.abs(answer.quantiles - expected).mean() < 0.03
    assert model.usable
    assert 0.9 < model.inside <= 1


def test_the_odds_are_bent_where_the_terms_cannot_follow(bent: ErrorModels, models: ErrorModels) -> None:
    (model,) = bent.models
    assert model.fit.knots.shape[1] > 0
    assert models.models[0].fit.knots.shape[1] == 0
    queries = np.random.default_rng(3).uniform((5, 0), (40, 0.8), (4000, 2))
    truth = ndtr((0.5 - beyond(*queries.T)) / 0.3)
    compared = calibration(model.predict(queries).miss, truth, np.zeros(len(truth), np.int64))
    assert compared.error < LIMIT + model.misses.chance  # 6 % where the odds are straight


def test_where_nobody_stood_is_outside(model: ErrorModel) -> None:
    queries = [[20.0, 0.4], [80.0, 0.4], [20.0, 0.98], [1.0, 0.0], [np.nan, 0.4]]
    assert model.predict(queries).inside.tolist() == [True, False, False, False, False]
    with pytest.raises(InvalidInput, match="one value per column"):
        model.predict([[20.0, 0.4, 1.0]])


@pytest.mark.parametrize("name", ["models", "bent"])
def test_the_onnx_file_answers_like_the_model(name: str, request: pytest.FixtureRequest) -> None:
    models: ErrorModels = request.getfixturevalue(name)
    (model,) = models.models
    session = onnxruntime.InferenceSession(to_onnx(model), providers=["CPUExecutionProvider"])
    queries = np.random.default_rng(2).uniform((-10, -0.5), (80, 1.5), (300, 2))
    miss, quantiles, inside = session.run(["miss", "quantiles", "inside"], {"queries": queries})
    expected = model.predict(queries)
    assert miss == pytest.approx(expected.miss, abs=1e-5)
    assert quantiles == pytest.approx(expected.quantiles, abs=1e-5)
    assert inside.tolist() == expected.inside.tolist()
    assert set(inside.tolist()) == {True, False}
    assert session.get_modelmeta().custom_metadata_map["columns"] == "distance_m,occlusion_rate"
    assert files_of(models) == files_of(models)


def test_card_and_table_say_what_the_model_says(models: ErrorModels, model: ErrorModel) -> None:
    files = files_of(models)
    assert set(files) == {CARD, "error-model.csv", "error-model.parquet", "error-model.png", "error-model-0.onnx"}
    (card,) = json.loads(files[CARD])["models"]
    assert (card["calibration_error"], card["inside"]) == (model.misses.error, model.inside)
    cells = pyarrow.parquet.read_table(BytesIO(files["error-model.parquet"]))
    centres = np.column_stack([cells[name].to_numpy() for name in NAMES])
    assert cells["miss"].to_numpy() == pytest.approx(model.predict(centres).miss)
    assert sum(cells["rows"].to_pylist()) == 3600


def test_too_few_places_are_refused_with_the_number_that_is_missing() -> None:
    assert fit_error_models(table(30), given=NAMES).refusals == {
        "net": "30 places are too few: 10 more are needed at least"
    }
    always = planted_table(np.full(60, 0.9), np.arange(60), design=Design((("grid", 60),)), distance_m=np.arange(60.0))
    assert "0 of 60 places with a miss are too few" in fit_error_models(always, given=("distance_m",)).refusals["net"]


def test_a_model_that_is_off_gets_no_file() -> None:
    weak = fit_error_models(table(50, persons=2), given=("distance_m",))
    assert not weak.models[0].usable
    assert "more places would reduce the error on new places to 2%" in weak.models[0].sentence
    assert set(files_of(weak)) == {CARD, "error-model.png"}


@pytest.mark.parametrize(("threshold", "given"), [(0.0, NAMES), (0.5, ("function",)), (0.5, ("contrast",))])
def test_questions_without_an_answer_are_refused(threshold: float, given: tuple[str, ...]) -> None:
    with pytest.raises(InvalidInput):
        fit_error_models(table(50), threshold=threshold, given=given)
