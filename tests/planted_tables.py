"""Long tables with planted scores, and the runs that they could come from."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from valerie.analysis.findings.findings import Finding, ScoredPerson, Step
from valerie.analysis.rows.design import Design
from valerie.analysis.rows.table import EvaluationTable
from valerie.measures import MEASURES
from valerie.parameters.blocks import Block, Variation
from valerie.parameters.definitions import ParameterDefinition
from valerie.parameters.distributions import Uniform
from valerie.parameters.space import ParameterSpace
from valerie.runs.resolving.requirements import Requirement, resolve_requirements
from valerie.runs.resolving.spec import RunSpec
from valerie.statistics.contrasts import Matching
from valerie.statistics.units import Estimand

X = "scene.person-1.pos.x"
DEFINITION, *_FURTHER = (
    ParameterDefinition.model_validate(
        {"path": path, "type": "FLOAT", "affects": "geometry", "minimum": 0, "maximum": 1000, "default": 0}
    )
    for path in (X, *(f"scene.person-{number}.pos.x" for number in range(2, 9)))
)
#: Pixels of every planted person that is seen.
PIXELS = 1000


def planted_table(
    pacc: ArrayLike, variants: ArrayLike, *, design: Design | None = None, **columns: Any
) -> EvaluationTable:
    """Return a table of one person a row, behind one camera; NaN is a fully hidden person.

    Args:
        pacc: (N,) shares of the person's pixels that are found.
        variants: (N,) variant of each row.
        design: that chose the variants; None: unknown.
        columns: further columns, (N,) or one value for all rows; the frame is that of the variant by default.
    """
    scores, index = np.asarray(pacc, np.float64), np.asarray(variants, np.int64)
    known, count = np.isfinite(scores), len(scores)
    tp = np.where(known, np.round(np.nan_to_num(scores) * PIXELS), 0).astype(np.int64)
    area = np.where(known, PIXELS, 0)
    filled: dict[str, Any] = {
        **{measure.name: np.full(count, np.nan) if measure.is_number else [None] * count for measure in MEASURES},
        "run_id": ["planted"] * count,
        "variant_index": index,
        "frame_id": [f"planted.{variant}.0.0" for variant in index.tolist()],
        "camera": ["camera-1"] * count,
        "character": ["somebody"] * count,
        "sensor": ["default"] * count,
        "function": ["net"] * count,
        "instance_id": np.full(count, 24001),
        "distance_m": np.full(count, 12.0),
        "pixel_area": area,
        "pixel_area_amodal": np.full(count, PIXELS),
        "tp": tp,
        "fn": area - tp,
        "fp": np.zeros(count, np.int64),
        "pacc": scores,
        "undefined_reason": [None if row else "fully hidden" for row in known],
        X: index.astype(np.float64),
    }
    for name, column in columns.items():
        filled[name] = [column] * count if isinstance(column, str | int | float) else column
    return EvaluationTable.from_columns(filled, {X: "FLOAT"}, {} if design is None else {"planted": design})


def planted_finding(before: ScoredPerson, after: ScoredPerson) -> Finding:
    """Return a confirmed finding that two views show: the sun of the later one is lower, and so is its pACC."""
    return Finding(
        sentence="planted",
        function=after.function,
        steps=(Step("sun-1.elevation", "40°", "5°"),),
        matching=Matching.BLOCKS,
        estimand=Estimand.LISTED_GRID,
        confirmed=True,
        effect=-0.2,
        low=-0.3,
        high=-0.1,
        places=40,
        pairs=80,
        places_needed=None,
        examples=((before, after),),
        spec="name: again\n",
    )


def drawn_space(design: str, count: int, *, dimensions: int = 1, seed: int = 0) -> ParameterSpace:
    """Return the space of one block that draws ``count`` variants of 0…1000."""
    definitions = [DEFINITION, *_FURTHER][:dimensions]
    variations = tuple(Variation(definition.path, Uniform()) for definition in definitions)
    return ParameterSpace(definitions, [Block(design=design, count=count, variations=variations)], seed=seed)


def drawn(design: str, count: int) -> Design:
    """Return the choice of ``count`` variants by one block."""
    return Design(((design, count),))


def requirement(statistic: str, functions: tuple[str, ...] = ("net",), **fields: Any) -> Requirement:
    """Return a requirement of a run with these functions."""
    document: Mapping[str, Any] = {"id": "R", "statistic": statistic, **fields}
    spec = RunSpec.model_validate({"name": "n", "asset": "a", "functions": functions, "requirements": [document]})
    (resolved,) = resolve_requirements(spec, [DEFINITION], ("camera-1",), [])
    return resolved
