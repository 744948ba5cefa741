"""The curve of a training: its points, also after an interruption, and its picture."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from valerie.errors import InvalidInput
from valerie.perception.training.curve import TrainingCurve
from valerie.perception.training.fit import TrainingProgress
from valerie.perception.training.held_out_figures import ValidationFigures


def step(number: int, steps: int, loss: float, pacc: float | None = None) -> TrainingProgress:
    figures = None if pacc is None else ValidationFigures(5, pacc, 0.5, 0.4, None)
    return TrainingProgress(number, steps, number / steps, loss, float(number), figures)


def test_the_loss_is_the_mean_of_the_steps_since_the_point_before(tmp_path: Path) -> None:
    curve = TrainingCurve(tmp_path / "curve.json")
    for number in range(1, 1001):
        curve(step(number, 1000, float(number)))
    assert len(curve.loss) == 200
    assert curve.loss[0] == (5, 3.0)
    assert curve.loss[-1] == (1000, 998.0)


def test_a_training_that_resumes_from_a_checkpoint_replaces_later_points(tmp_path: Path) -> None:
    first = TrainingCurve(tmp_path / "curve.json")
    for number in range(1, 9):
        first(step(number, 10, 1.0, pacc=0.1 * number if number % 2 == 0 else None))
    again = TrainingCurve(tmp_path / "curve.json")
    for number in range(5, 11):
        again(step(number, 10, 2.0, pacc=0.9 if number == 6 else None))
    again.finish(10, ValidationFigures(20, 0.95, 0.5, 0.4, 0.3), title="t")
    kept = TrainingCurve(tmp_path / "curve.json")
    assert [loss for _, loss in kept.loss] == [1.0] * 4 + [2.0] * 6
    assert [(entry.step, entry.figures.person_pacc) for entry in kept.validations] == [
        (2, 0.2),
        (4, 0.4),
        (6, 0.9),
        (10, 0.95),
    ]


def test_finishing_twice_changes_nothing(tmp_path: Path) -> None:
    file = tmp_path / "curve.json"
    curve = TrainingCurve(file)
    curve(step(1, 1, 3.0))
    curve.finish(1, ValidationFigures(2, 0.5, 0.5, 0.5, 0.5), title="t")
    before = file.read_bytes()
    TrainingCurve(file).finish(1, ValidationFigures(2, 0.5, 0.5, 0.5, 0.5), title="t")
    assert file.read_bytes() == before


def test_the_picture_shows_the_loss_and_every_figure_in_a_colour_of_its_own(tmp_path: Path) -> None:
    curve = TrainingCurve(tmp_path / "curve.json")
    for number in range(1, 401):
        pacc = 0.9 - 0.6 * 0.99**number if number % 100 == 0 else None
        curve(step(number, 400, 0.3 + 2 * 0.98**number, pacc))
    picture = curve.finish(400, ValidationFigures(60, 0.9, 0.7, 0.6, 0.5), title="semantic-fpn-small, 224 frames")
    assert picture == tmp_path / "curve.png"
    with Image.open(picture) as opened:
        colours = {tuple(colour) for colour in np.asarray(opened.convert("RGB")).reshape(-1, 3).tolist()}
    for colour in ((0x55,) * 3, (0x00, 0x72, 0xB2), (0xE6, 0x9F, 0x00), (0xCC, 0x79, 0xA7), (0x00, 0x9E, 0x73)):
        assert colour in colours


@pytest.mark.parametrize(
    "text",
    [
        "no json",
        "[]",
        '{"loss": [[1]], "figures": []}',
        '{"loss": [], "figures": [{}]}',
        '{"loss": [], "figures": [1]}',
    ],
)
def test_something_else_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "curve.json").write_text(text)
    with pytest.raises(InvalidInput, match="not the curve of a training"):
        TrainingCurve(tmp_path / "curve.json")
