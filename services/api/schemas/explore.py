"""Answers about the rows of one or several runs: columns, histograms, links, rates, pairs, saved selections."""

from __future__ import annotations

from typing import Annotated, Final

from pydantic import BaseModel, Field, computed_field

from services.api.schemas.base import FUNCTION, RUN_ID, Read
from services.api.schemas.results import INTERVAL
from valerie.analysis.summary.wording import interval_sentences
from valerie.measures import Cell
from valerie.pipeline.exploring.class_confusion import Confusion
from valerie.pipeline.exploring.exploration import ExploredColumn
from valerie.pipeline.exploring.exploration_cache import MAX_RUNS
from valerie.pipeline.exploring.linked_views import GroupRates, Histogram, Links
from valerie.pipeline.exploring.pairs import Comparison, Swing
from valerie.plain import JsonObject
from valerie.runs.moments import Moment
from valerie.runs.products.frame_keys import ID

#: The name of a saved selection, and text that a database can hold, as regular expressions.
SELECTION_NAME: Final = r"^[^\x00-\x1f/]+$"
_TEXT: Final = r"^[^\x00]*$"
_ROW: Final = {"frame_id": f"{RUN_ID}.5.0.0", "function": FUNCTION, "pacc": 0.9041}


class ColumnsRead(Read):
    """The columns of the rows of some runs."""

    rows: int = Field(examples=[60])
    threshold: float = Field(description="of the detection rate; the first run's", examples=[0.5])
    read_at: Moment | None = Field(description="when the rows were read", examples=["2026-11-21T14:05:00Z"])
    functions: dict[str, list[str]] = Field(description="of each run", examples=[{RUN_ID: [FUNCTION]}])
    columns: list[ExploredColumn] = Field(
        examples=[
            [
                {
                    "name": "distance_m",
                    "title": "distance",
                    "description": "distance from camera to person",
                    "unit": "m",
                    "scale": 1.0,
                    "digits": 2,
                    "group": "person",
                    "numeric": True,
                    "low": 5.1,
                    "high": 38.9,
                    "names": [],
                    "undefined": 0,
                }
            ]
        ]
    )


class HistogramsRead(Read):
    selected: int = Field(examples=[12])
    histograms: list[Histogram] = Field(
        examples=[
            [
                {
                    "column": "distance_m",
                    "levels": [],
                    "edges": [5.0, 6.0, 7.0],
                    "every": [3, 4, 0],
                    "selected": [1, 2, 0],
                }
            ]
        ]
    )


class LinksRead(Read):
    selected: int = Field(examples=[12])
    links: list[Links] = Field(
        examples=[[{"before": "distance_m", "after": "pacc", "pairs": [[0, 12, 3], [1, 40, 2]]}]]
    )


class RowsRead(Read):
    selected: int = Field(description="rows that the expression selects", examples=[12])
    items: list[dict[str, Cell | bool]] = Field(
        description="rows of the long table; `row number` identifies a row among these runs",
        examples=[[_ROW | {"row number": 5}]],
    )


_RATES: Final[JsonObject] = {
    "persons": 30,
    "undefined": {"fully hidden": 2},
    "pacc": INTERVAL,
    "detected": {**INTERVAL, "low": 0.8, "high": 0.97, "estimate": 0.93},
    "why": "",
}


class RatesRead(Read):
    selected: int = Field(examples=[12])
    scored: bool = Field(
        description="whether the expression depends on scores; then the rates only repeat the selection",
        examples=[False],
    )
    threshold: float = Field(examples=[0.5])
    groups: list[GroupRates] = Field(
        description="by run, function and sensor",
        examples=[[{"run": RUN_ID, "function": FUNCTION, "sensor": "default", "selected": _RATES, "beside": _RATES}]],
    )

    @computed_field(  # type: ignore[prop-decorator]
        description="what intervals of the selection are for",
        examples=[["[95 % interval] for the space that the design draws from, from 48 variants."]],
    )
    @property
    def certainty(self) -> list[str]:
        return interval_sentences(group.selected.pacc for group in self.groups)


class ComparisonRead(Read):
    """Two sides matched person by person."""

    comparison: Comparison = Field(
        examples=[
            {
                "rows": [30, 30],
                "matched": 28,
                "outcomes": {"fixed": 3, "broken": 1, "both missed": 2, "both found": 22, "lower": 9, "higher": 14},
                "difference": 0.04,
                "low": 0.01,
                "high": 0.07,
                "places": 12,
                "precision": [0.81, 0.79],
                "iou": [0.62, 0.65],
                "pairs": [{"before": 5, "after": 35, "pacc_before": 0.2, "pacc_after": 0.9}],
                "held": ["scene.sun-1.elevation"],
            }
        ]
    )
    differs: list[str] = Field(
        description="what the specs of the two runs set differently and changes frames",
        examples=[["constants.sun-1.elevation (35.0 before, -4.0 after)"]],
    )
    rows: dict[int, dict[str, Cell | bool]] = Field(description="rows by their number", examples=[{5: _ROW, 35: _ROW}])


class SwingsRead(Read):
    swings: list[Swing] = Field(
        examples=[
            [
                {
                    "parameter": "scene.sun-1.azimuth",
                    "pair": {"before": 5, "after": 35, "pacc_before": 0.9, "pacc_after": 0.2},
                }
            ]
        ]
    )
    rows: dict[int, dict[str, Cell | bool]] = Field(description="rows by their number", examples=[{5: _ROW, 35: _ROW}])


class ConfusionRead(Read):
    """Pixels by true and predicted class."""

    confusion: Confusion = Field(
        examples=[
            {
                "function": FUNCTION,
                "evaluations": 12,
                "classes": ["road", "sidewalk"],
                "counts": [[9000, 20, 0], [30, 800, 1]],
                "frames": [{"row": 5, "pixels": 18}],
            }
        ]
    )
    rows: dict[int, dict[str, Cell | bool]] = Field(description="rows by their number", examples=[{5: _ROW}])


class SpecRead(Read):
    """A spec that can be submitted."""

    yaml: str = Field(examples=["schema_version: 1\nname: dusk\nasset: urban-street\n"])


class NewSelection(BaseModel, extra="forbid"):
    """A selection to save."""

    name: Annotated[str, Field(min_length=1, max_length=120, pattern=SELECTION_NAME, examples=["dark and far"])]
    runs: Annotated[
        tuple[Annotated[str, Field(pattern=ID)], ...],
        Field(min_length=1, max_length=MAX_RUNS, examples=[[RUN_ID]]),
    ]
    expression: Annotated[str, Field(max_length=2000, pattern=_TEXT, examples=["distance_m > 25"])] = ""
    view: Annotated[
        str,
        Field(
            max_length=4000,
            pattern=_TEXT,
            description="query of the page's address",
            examples=["x=distance_m&y=pacc"],
        ),
    ] = ""


class SelectionRead(NewSelection):
    created_at: Moment = Field(examples=["2026-11-21T14:05:00Z"])
