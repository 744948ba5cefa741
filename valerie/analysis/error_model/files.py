"""The files of a run's perception-error models: ONNX, table, card and reliability diagram."""

from __future__ import annotations

from io import BytesIO
from typing import Final

import numpy as np
import pyarrow as pa
from pydantic import Field

from valerie.analysis.error_model.model import LEVELS, LIMIT, ErrorModel, ErrorModels
from valerie.analysis.error_model.onnx_export import check_onnx, to_onnx
from valerie.analysis.report.plots import INK, RULE
from valerie.analysis.rows.table import encoded
from valerie.document import Document
from valerie.errors import MissingDependency
from valerie.measures import measure_of
from valerie.statistics.calibration import ReliabilityBin

CARD: Final = "error-model.json"
_TABLE: Final = "error-model"
_DIAGRAM: Final = "error-model.png"


class ColumnCard(Document):
    """A column of the queries.

    Attributes:
        name, title, unit, description: as in the long table.
        low, high: range of the training rows.
        cell: width of a cell of the support.
    """

    name: str
    title: str
    unit: str
    description: str
    low: float
    high: float
    cell: float


class ModelCard(Document):
    """The error model of one function.

    Attributes:
        function: its name.
        file: its ONNX file; None if the model is not calibrated well enough.
        columns: columns of a query, in order.
        miss_rate: share of the training rows that are misses.
        rows, places: held-out rows inside the support, and their places.
        calibration_error: of misses, on held-out places.
        chance, on_new_places: see `valerie.statistics.calibration.Calibration`.
        places_needed: see `valerie.analysis.error_model.model.ErrorModel`.
        quantile_shares: share of held-out rows up to each quantile.
        quantile_error: mean distance of these from their levels.
        inside: share of held-out rows inside the support of the other places.
        sentence: the calibration in words.
        onnx_difference: largest difference between the answers of the file and the model; None without a file.
        reliability: bins of the reliability diagram.
    """

    function: str
    file: str | None
    columns: tuple[ColumnCard, ...]
    miss_rate: float
    rows: int
    places: int
    calibration_error: float
    chance: float
    on_new_places: float
    places_needed: int
    quantile_shares: tuple[float, ...]
    quantile_error: float
    inside: float
    sentence: str
    onnx_difference: float | None
    reliability: tuple[ReliabilityBin, ...]


class ErrorModelCard(Document):
    """Card of a run's error models: their files, calibration and limits.

    Attributes:
        run, table: id of the run, and the digest of its long table without ids, as in the evidence of the run.
        threshold: a person with pACC below it is a miss.
        levels: levels of the quantiles of pACC.
        limit: largest calibration error of a model with a file.
        conditions: values that the run held constant; the models say nothing about others.
        statement: the limits of validity in words.
        models: models of the functions that have one.
        refusals: function to the reason why it has none.
        left_out: column to the reason why no model uses it.
    """

    run: str
    table: str
    threshold: float
    levels: tuple[float, ...] = LEVELS
    limit: float = LIMIT
    conditions: dict[str, str] = Field(default_factory=dict)
    statement: str = (
        "An answer is valid where `inside` is true: the run has persons within one cell of the query in every column."
        " Elsewhere the model repeats the values at its edge. It is valid for the run's asset, cameras, resolution,"
        " pedestrians, light and engine. It says nothing about false alarms, about persons without a visible pixel, or"
        " about how the errors of successive frames are correlated."
    )
    models: tuple[ModelCard, ...]
    refusals: dict[str, str]
    left_out: dict[str, str]


def error_model_files(
    models: ErrorModels, *, run: str, table: str, threshold: float, conditions: dict[str, str]
) -> dict[str, bytes]:
    """Return file name to content: card, table and diagram, and one ONNX file for each usable model.

    Args:
        models: models of the run.
        run: its id.
        table: digest of its long table.
        threshold: pACC below which a person is a miss.
        conditions: path to value, as text, of constant parameters.

    Raises:
        CorruptArtifact: an ONNX file and its model differ.
        MissingDependency: matplotlib or onnxruntime is not installed.
    """
    files: dict[str, bytes] = {}
    cards = []
    for number, model in enumerate(models.models):
        name, difference = None, None
        if model.usable:
            name, data = f"error-model-{number}.onnx", to_onnx(model)
            difference = check_onnx(model, data, _queries(model))
            files[name] = data
        cards.append(_card(model, name, difference))
    card = ErrorModelCard(
        run=run,
        table=table,
        threshold=threshold,
        conditions=conditions,
        models=tuple(cards),
        refusals=models.refusals,
        left_out=models.left_out,
    )
    files[CARD] = card.model_dump_json(indent=1).encode() + b"\n"
    usable = [model for model in models.models if model.usable]
    if usable:
        cells = pa.concat_tables([_cell_table(model) for model in usable])
        files |= {f"{_TABLE}.{suffix}": encoded(cells, suffix) for suffix in ("csv", "parquet")}
    if models.models:
        files[_DIAGRAM] = reliability_diagram(models.models)
    return files


def _card(model: ErrorModel, file: str | None, difference: float | None) -> ModelCard:
    columns = []
    for name, (low, high), cell in zip(model.columns, model.ranges, model.fit.support.widths.tolist(), strict=True):
        measure = measure_of(name)
        unit = "share" if measure.unit == "%" else measure.unit
        columns.append(
            ColumnCard(
                name=name,
                title=measure.title,
                unit=unit,
                description=measure.description,
                low=low,
                high=high,
                cell=cell,
            )
        )
    return ModelCard(
        function=model.function,
        file=file,
        columns=tuple(columns),
        miss_rate=model.miss_rate,
        rows=model.misses.rows,
        places=model.misses.places,
        calibration_error=model.misses.error,
        chance=model.misses.chance,
        on_new_places=model.misses.on_new_places,
        places_needed=model.places_needed,
        quantile_shares=model.quantile_shares,
        quantile_error=model.quantile_error,
        inside=model.inside,
        sentence=model.sentence,
        onnx_difference=difference,
        reliability=model.misses.bins,
    )


def _cell_table(model: ErrorModel) -> pa.Table:
    """Return one row per cell of the support: its centre, the answers there, and the number of training rows."""
    support = model.fit.support
    answer = model.predict(support.centres)
    return pa.table(
        {
            "function": [model.function] * len(support.centres),
            **dict(zip(model.columns, support.centres.T, strict=True)),
            "miss": answer.miss,
            **{f"pacc_q{round(100 * level):02d}": answer.quantiles[:, i] for i, level in enumerate(LEVELS)},
            "rows": support.rows,
        }
    )


def _queries(model: ErrorModel) -> np.typing.NDArray[np.float64]:
    """Return queries for the check: centres of cells, points in the range, and points beyond it."""
    rng = np.random.default_rng(0)
    low, high = np.transpose(model.ranges)
    beyond = rng.uniform(2 * low - high, 2 * high - low, (200, len(low)))
    return np.concatenate((model.fit.support.centres, rng.uniform(low, high, (500, len(low))), beyond))


def reliability_diagram(models: tuple[ErrorModel, ...]) -> bytes:
    """Draw the observed share of misses over the predicted one for each bin of held-out rows; return a PNG.

    Raises:
        MissingDependency: matplotlib is not installed.
    """
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise MissingDependency("the reliability diagram needs matplotlib: install valerie[report]") from error
    figure = Figure(figsize=(4.2 * len(models), 4.4), dpi=150, layout="constrained")
    for axes, model in zip(figure.subplots(1, len(models), squeeze=False)[0], models, strict=True):
        bins = model.misses.bins
        axes.plot([0, 100], [0, 100], color=RULE, linewidth=1.5, zorder=0)
        sizes = [20 + 400 * point.rows / model.misses.rows for point in bins]
        predicted, observed = [100 * point.predicted for point in bins], [100 * point.observed for point in bins]
        axes.plot(predicted, observed, color="#0072B2", linewidth=1, zorder=1)
        axes.scatter(predicted, observed, s=sizes, color="#0072B2", alpha=0.7, linewidths=0, zorder=2)
        axes.set_title(
            f"{model.function}\ncalibration error {model.misses.error:.1%}, {model.misses.places:,} places",
            fontsize=9,
            color=INK,
        )
        axes.set(xlabel="predicted probability of a miss (%)", ylabel="observed share of misses (%)")
        axes.set(xlim=(-4, 104), ylim=(-4, 104), aspect="equal")
        axes.grid(color=RULE, linewidth=0.6)
        for side in ("top", "right"):
            axes.spines[side].set_visible(False)
    sink = BytesIO()
    figure.savefig(sink, format="png", metadata={"Software": None})
    return sink.getvalue()
