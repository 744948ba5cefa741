"""The output of `valerie evaluate` for functions that know unequal classes and run unlike."""

from __future__ import annotations

from io import StringIO
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from valerie.cli.evaluation import renderables
from valerie.labels import PERSON
from valerie.metrics.collection import collection_scores
from valerie.perception.base import FunctionCard
from valerie.pipeline.retraining.dataset_evaluation import DatasetResult, FunctionResult

ROAD, VOID = 0, 19


def function(name: str, numeric_class: str, *judged_by: str) -> FunctionResult:
    """Finds all 40 pixels of a person; of 100 of road those that are nothing to it are void."""
    matrix = np.zeros((19, 20), np.int64)
    matrix[PERSON.train_id, PERSON.train_id] = 40
    matrix[ROAD, VOID if judged_by else ROAD] = 100
    card = FunctionCard(name, "0" * 64, "test", "fp32", "numpy", {}, judged_by)
    scores = collection_scores([matrix], card.judged_ids)
    return FunctionResult(name, card, numeric_class, ("frame",), (matrix,), scores, (), (), 1.0)


def printed(*functions: FunctionResult) -> str:
    sink = StringIO()
    console = Console(file=sink, width=250, color_system=None)
    for part in renderables(DatasetResult(Path("set"), "val", "0" * 64, False, functions), None, {}):
        console.print(part)
    return sink.getvalue()


def test_a_class_that_a_function_is_not_judged_by_is_a_dash_and_a_note_says_so() -> None:
    text = printed(function("net", "torch-fp32"), function("person-or-not", "torch-fp32", "person"))
    (road,) = [line for line in text.splitlines() if line.startswith("road ")]
    assert road.split() == ["road", "100.00", "/", "100.00", "–"]
    assert "person-or-not is judged by person alone; its mIoU covers only these." in text
    assert "net is judged" not in text


@pytest.mark.parametrize(
    ("other", "told"),
    [
        ("torch-fp32", "Run as torch-fp32."),
        ("openvino-bf16", "Run as a: torch-fp32; b: openvino-bf16: numeric classes differ."),
    ],
)
def test_the_numeric_classes_stand_below_the_table(other: str, told: str) -> None:
    assert told in printed(function("a", "torch-fp32"), function("b", other))
