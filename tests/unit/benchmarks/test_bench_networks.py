"""Frames that the aim of the shipped networks counts, and their count by hand."""

import numpy as np
import pytest

from benchmarks.bench_networks import show, statistics
from valerie.labels import PERSON
from valerie.metrics.matrix import SHAPE, ConfusionMatrix

ROAD = 0
VOID = 19


def frame(*, found: int, missed: int, false: int, void: int = 0, road: int = 1000) -> ConfusionMatrix:
    """Person pixels found, called road, and called nothing; road pixels called person, and the rest of the road."""
    matrix = np.zeros(SHAPE, np.int64)
    matrix[PERSON.train_id, PERSON.train_id], matrix[PERSON.train_id, ROAD] = found, missed
    matrix[PERSON.train_id, VOID] = void
    matrix[ROAD, PERSON.train_id], matrix[ROAD, ROAD] = false, road
    return matrix


FRAMES = [
    frame(found=300, missed=100, false=100),
    frame(found=50, missed=40, false=0, void=10),  # 100 pixels: the least that counts
    frame(found=0, missed=99, false=301),  # one pixel too few
    frame(found=0, missed=0, false=0),  # nobody
]


def test_the_aim_pools_frames_with_enough_visible_pixels() -> None:
    part = statistics(FRAMES)["visible"]
    assert part["frames"] == 2
    assert part["pooled"]["pacc"] == pytest.approx(350 / 500)
    assert part["pooled"]["precision"] == pytest.approx(350 / 450)
    assert part["pooled"]["iou"] == pytest.approx(350 / 600)
    road = 2000 / (2000 + 100 + 140)
    assert part["pooled"]["miou"] == pytest.approx((350 / 600 + road) / 2)


def test_frame_means_weigh_each_frame_the_same() -> None:
    part = statistics(FRAMES)["visible"]
    assert part["frame_mean"]["pacc"] == pytest.approx((300 / 400 + 50 / 100) / 2)
    assert part["frame_mean"]["precision"] == pytest.approx((300 / 400 + 1) / 2)


def test_all_frames_stand_beside_with_how_many_define_a_figure() -> None:
    part = statistics(FRAMES)["all"]
    assert part["frames"] == 4
    assert part["pooled"]["pacc"] == pytest.approx(350 / 599)
    assert part["pooled"]["precision"] == pytest.approx(350 / 751)
    assert part["defined_in"] == {"pacc": 3, "precision": 3, "iou": 3, "miou": 4}


def test_the_threshold_can_be_another() -> None:
    assert [statistics(FRAMES, least)["visible"]["frames"] for least in (0, 99, 100, 101, 10_000)] == [4, 3, 2, 1, 0]


def test_what_is_printed_says_where_the_aim_stands(capsys: pytest.CaptureFixture[str]) -> None:
    show("raster", {"net": statistics(FRAMES)}, aims={"pacc": 0.85, "precision": 0.75})
    printed = capsys.readouterr().out
    assert "70.0 (2)" in printed
    assert "aim: pACC missed (≥ 85), precision reached (≥ 75)" in printed
    show("cycles", {"net": statistics([])}, aims={})
    assert "undefined (0)" in capsys.readouterr().out
    show("raster", {"net": statistics([])}, aims={"miou": 0.6})
    assert "aim: mIoU undefined (≥ 60)" in capsys.readouterr().out
