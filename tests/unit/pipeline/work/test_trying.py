"""A function on a few frames before it is registered."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.world.boxes import write_box_street
from valerie.errors import InvalidInput
from valerie.labels import PERSON, TRAIN_LABELS
from valerie.perception.running.small_network import small_onnx
from valerie.pipeline.work.trying import contact_sheet, render_frames, try_function
from valerie.runs.document.run_spec import RunSpec
from valerie.runs.resolving.spec import parse
from valerie.settings import Settings, load_settings

ROAD = next(label.train_id for label in TRAIN_LABELS if label.name == "road")


@pytest.fixture
def settings(tmp_path: Path) -> Settings:
    write_box_street(tmp_path / "assets" / "box-street")
    return load_settings({}, data_dir=tmp_path / "data", asset_dir=tmp_path / "assets")


def spec(**changes: object) -> RunSpec:
    vary = {"person-1.pos.x": {"choice": [-3.0, -2.5, -2.0]}}
    base = {"name": "three", "asset": "box-street", "vary": vary, "resolution": {"width": 96, "height": 54}}
    return parse({**base, "functions": ["none-of-these"], **changes})


def test_the_confusion_counts_the_pixels_that_the_function_takes_for_each_class(
    settings: Settings, tmp_path: Path
) -> None:
    frames = render_frames(spec(), settings, 3)
    _, tried = try_function(*small_onnx(tmp_path), frames, settings)
    assert len(tried) == 3
    for frame, result in zip(frames, tried, strict=True):
        # The network takes pixels whose channels add up to less than 0.75 for persons.
        dark = frame.picture.sum(axis=2) < 0.75 * 255
        for truth in (PERSON.train_id, ROAD):
            row = result.confusion[truth]
            assert row[PERSON.train_id] == np.count_nonzero(dark & (frame.truth == truth))
            assert row[ROAD] == np.count_nonzero(~dark & (frame.truth == truth))
    assert sum(int(result.confusion[PERSON.train_id].sum()) for result in tried) > 0


def test_a_sheet_has_a_row_for_each_frame_that_begins_with_its_picture(settings: Settings, tmp_path: Path) -> None:
    frames = render_frames(spec(), settings, 2)
    sheet = contact_sheet(try_function(*small_onnx(tmp_path), frames, settings)[1])
    assert sheet.shape == (2 * 54 + 4, 5 * 96 + 4 * 4, 3)
    assert np.array_equal(sheet[:54, :96], frames[0].picture)
    assert np.array_equal(sheet[58:, :96], frames[1].picture)
    assert np.array_equal(sheet[:54, 100:196], frames[0].picture)  # this network takes frames of any size


def test_a_spec_without_an_accepted_variant_has_no_frames(settings: Settings) -> None:
    with pytest.raises(InvalidInput, match="every variant is rejected"):
        render_frames(spec(constraints=["person-1.pos.x > 5"]), settings, 3)
