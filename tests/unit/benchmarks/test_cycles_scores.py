"""The validation from end to end, with an engine whose noise, like Cycles', depends on seed, samples and place alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import t as student

from benchmarks import cycles_scores
from benchmarks.cycles_frames import GROUPS, Planned
from benchmarks.cycles_parts import Parts
from benchmarks.cycles_render import REFERENCE, Studio, composed, part, strips_of, window_key
from benchmarks.cycles_scores import Scores, estimate, of_layers, of_presets, ratio
from valerie.rendering.base import Rectangle, View
from valerie.rendering.cycles import translation
from valerie.rendering.cycles.translation import Guided
from valerie.testing.assets import simple_asset

VIEW = View("camera-1", 24, 16)
FRAME = Planned(5, GROUPS[0], simple_asset().base, VIEW, Rectangle(9, 5, 6, 6), Rectangle(7, 3, 10, 10))
BODY = Rectangle(10, 6, 3, 4)


@dataclass
class Engine:
    """Stands in for Blender; ``spill`` is light that the pedestrian throws beyond the rectangle."""

    cpu_seconds: float = 0.0
    spill: float = 0.0
    fails_at: int | None = None
    calls: int = 0

    def get(self) -> Engine:
        return self

    def guided(
        self,
        _: object,
        scene: object,
        view: View,
        settings: Mapping[str, Any],
        *,
        border: Rectangle,
        movables: bool,
    ) -> Guided:
        if self.calls == self.fails_at:
            raise KeyboardInterrupt
        self.calls += 1
        self.cpu_seconds += settings["samples"] * border.width * border.height / 1e5
        drawn = np.random.default_rng([settings["seed"], settings["samples"]]).standard_normal(
            (VIEW.height, VIEW.width, 3)
        )
        pixels = 0.4 + 0.5 * drawn / np.sqrt(settings["samples"])
        if movables:
            pixels += self.spill
            pixels[BODY.slices] += 0.5
        part = pixels[border.slices].astype(np.float32)
        return Guided(part, part * 0 + 0.5, part * 0)

    def denoised(self, _: object, given: Guided) -> NDArray[np.float32]:
        self.calls += 1
        return (0.5 * given.noisy + 0.2).astype(np.float32)


class Bright:
    """A function that takes for a person what is brighter than grey."""

    revision, numeric_class = 1, "test"

    def __init__(self, digest: str = "a") -> None:
        self.card = SimpleNamespace(digest=digest)
        self.asked = 0

    def predict(self, picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
        self.asked += 1
        return np.where(picture.mean(axis=2) > 150, 11, 0).astype(np.uint8)


@pytest.fixture
def engine(monkeypatch: pytest.MonkeyPatch) -> Engine:
    renderer = Engine()
    monkeypatch.setattr(translation, "guided", renderer.guided)
    monkeypatch.setattr(translation, "denoised", renderer.denoised)
    return renderer


def parts_in(folder: Path, *frames: Planned) -> Parts:
    """With the truth, which needs no Blender, already there."""
    parts = Parts(folder, {"revision": 1})
    for frame in frames:
        mask = np.zeros((VIEW.height, VIEW.width), bool)
        mask[BODY.slices] = True
        if f"{frame.index}/person" not in parts:
            parts.add(f"{frame.index}/person", {"mask": mask}, pixels=int(mask.sum()), distance_m=20.0)
    return parts


def scored(folder: Path, parts: Parts, *frames: Planned, function: Bright | None = None) -> dict[str, Any]:
    return of_layers(parts, frames, Scores(parts, folder, {"bright": function or Bright()}))  # type: ignore[dict-item]


def test_a_layer_of_the_same_samples_is_as_far_from_the_frame_as_another_seed_is(
    tmp_path: Path, engine: Engine
) -> None:
    parts = parts_in(tmp_path, FRAME)
    Studio(parts, engine, str).frame(FRAME)  # type: ignore[arg-type]
    scores = scored(tmp_path, parts, FRAME)
    for kind in ("noisy", "denoised"):
        inside = scores[f"{kind} rectangle"]
        assert inside["layer_to_seeds"]["mean"] == 1.0
        assert inside["layer_same_seed"]["largest"] == 0.0
        assert inside["seeds"]["mean"] > 0
        assert scores[f"{kind} around"]["layer_same_seed"]["largest"] == 0.0


def test_light_that_leaves_the_rectangle_is_seen_around_it(tmp_path: Path, engine: Engine) -> None:
    engine.spill = 0.4
    parts = parts_in(tmp_path, FRAME)
    Studio(parts, engine, str).frame(FRAME)  # type: ignore[arg-type]
    scores = scored(tmp_path, parts, FRAME)
    assert scores["noisy rectangle"]["layer_to_seeds"]["mean"] == 1.0
    assert scores["noisy around"]["layer_to_seeds"]["mean"] > 2


def test_paired_pacc_is_of_the_layered_frame_and_the_frame_of_another_seed(tmp_path: Path, engine: Engine) -> None:
    parts = parts_in(tmp_path, FRAME)
    Studio(parts, engine, str).frame(FRAME)  # type: ignore[arg-type]
    (row,) = scored(tmp_path, parts, FRAME)["frames"]
    shown, mask = cycles_scores.pictures(parts, FRAME), parts.arrays("5/person")["mask"]
    by_hand = {
        name: 100 * float((shown[f"{name} denoised"].mean(axis=2)[mask] > 150).mean())
        for name in ("layered", "same seed", "other seed")
    }
    assert row["bright"]["full"] == pytest.approx(by_hand["same seed"])
    assert row["bright"]["layer"] == pytest.approx(by_hand["layered"] - by_hand["other seed"])
    assert row["bright"]["layer_same_seed"] == pytest.approx(by_hand["layered"] - by_hand["same seed"])


def test_a_frame_of_one_seed_is_compared_with_that_alone(tmp_path: Path, engine: Engine) -> None:
    engine.spill = 0.4
    other = replace(FRAME, index=6)
    parts = parts_in(tmp_path, FRAME, other)
    studio = Studio(parts, engine, str)  # type: ignore[arg-type]
    studio.frame(FRAME)
    once = engine.calls
    studio.frame(other, other_seed=False)
    assert engine.calls - once == 1 + 2, "a window, the frame denoised and the layer denoised"
    scores = scored(tmp_path, parts, FRAME, other)
    assert scores["count"] == 2
    for compared in (scores["bright"], scores["noisy around"]):
        assert (compared["layer_same_seed"]["count"], compared["layer"]["count"], compared["seeds"]["count"]) == (
            2,
            1,
            1,
        )
    assert scores["noisy around"]["layer_same_seed"]["mean"] > 0
    assert scores["noisy around"]["layer_to_seeds"]["count"] == 1


def test_a_pedestrian_that_nobody_sees_has_differences_but_no_pacc(tmp_path: Path, engine: Engine) -> None:
    parts = Parts(tmp_path, {})
    parts.add("5/person", {"mask": np.zeros((VIEW.height, VIEW.width), bool)}, pixels=0, distance_m=20.0)
    studio = Studio(parts, engine, str)  # type: ignore[arg-type]
    studio.frame(FRAME)
    studio.presets(FRAME)
    scores = scored(tmp_path, parts, FRAME)
    assert scores["count"] == 1
    assert scores["bright"]["layer"] is None
    presets = of_presets(parts, [FRAME], Scores(parts, tmp_path, {"bright": Bright()}))  # type: ignore[dict-item]
    assert presets["rows"]["64"]["rmse_grey_levels"]["count"] == 1
    assert presets["rows"]["64"]["bright"] is None


def test_every_quality_is_compared_with_the_reference_and_more_samples_are_nearer(
    tmp_path: Path, engine: Engine
) -> None:
    parts = parts_in(tmp_path, FRAME)
    studio = Studio(parts, engine, str)  # type: ignore[arg-type]
    studio.frame(FRAME)
    studio.presets(FRAME)
    scores = of_presets(parts, [FRAME], Scores(parts, tmp_path, {"bright": Bright()}))  # type: ignore[dict-item]
    assert scores["frames"] == [5]
    for error in ("rmse_grey_levels", "rmse_linear"):
        few, default, many = (scores["rows"][name][error]["mean"] for name in ("16", "64", "256"))
        assert few > default > many > 0
    assert scores["cost"]["window 1024"]["cpu_s_per_megapixel"] == pytest.approx(10.0 * REFERENCE, rel=0.01)


def test_a_window_of_many_samples_stands_in_the_mean_of_two_backgrounds(tmp_path: Path, engine: Engine) -> None:
    parts = parts_in(tmp_path, FRAME)
    Studio(parts, engine, str).presets(FRAME)  # type: ignore[arg-type]
    frame = composed(parts, FRAME, 256, 0)
    outside = np.ones((VIEW.height, VIEW.width), bool)
    outside[FRAME.window.slices] = False
    both = (part(parts, "a/background/64/0").noisy + part(parts, "a/background/64/1").noisy) / 2
    np.testing.assert_array_equal(frame.noisy[outside], both[outside])
    np.testing.assert_array_equal(frame.noisy[FRAME.window.slices], part(parts, window_key(FRAME, 256, 0)).noisy)


def test_work_that_was_ended_goes_on_where_it_stopped(tmp_path: Path, engine: Engine) -> None:
    strip = 64 * 24 * 4  # backgrounds come in four strips
    engine.fails_at = 3
    with pytest.raises(KeyboardInterrupt):
        Studio(parts_in(tmp_path, FRAME), engine, str, strip=strip).frame(FRAME)  # type: ignore[arg-type]
    engine.fails_at = None
    parts = parts_in(tmp_path, FRAME)
    studio = Studio(parts, engine, str, strip=strip)  # type: ignore[arg-type]
    assert studio.frame(FRAME)
    # Two backgrounds in four strips, two windows, and four pictures denoised: each once.
    assert engine.calls == 2 * 4 + 2 + 4
    assert part(parts, "a/background/64/0").noisy.shape == (VIEW.height, VIEW.width, 3)
    assert not studio.frame(FRAME)
    assert engine.calls == 14


@pytest.mark.parametrize("samples", [1, 64, 100_000_000])
def test_strips_tile_a_rectangle_from_top_to_bottom(samples: int) -> None:
    where = Rectangle(5, 7, 960, 31)
    labels = np.zeros((60, 1000), int)
    for strip in strips_of(where, samples):
        labels[strip.slices] += 1
    expected = np.zeros_like(labels)
    expected[where.slices] = 1
    np.testing.assert_array_equal(labels, expected)


def test_a_function_is_asked_once_and_its_successor_again(tmp_path: Path, engine: Engine) -> None:
    parts = parts_in(tmp_path, FRAME)
    Studio(parts, engine, str).frame(FRAME)  # type: ignore[arg-type]
    first, same, successor = Bright(), Bright(), Bright("b")
    once = scored(tmp_path, parts, FRAME, function=first)
    assert scored(tmp_path, parts, FRAME, function=same) == once
    scored(tmp_path, parts, FRAME, function=successor)
    assert (first.asked, same.asked, successor.asked) == (3, 0, 3)


def test_only_finished_frames_count(tmp_path: Path, engine: Engine) -> None:
    other = replace(FRAME, index=6)
    parts = parts_in(tmp_path, FRAME, other)
    Studio(parts, engine, str).frame(FRAME)  # type: ignore[arg-type]
    assert scored(tmp_path, parts, FRAME, other)["count"] == 1


def test_an_interval_is_students() -> None:
    values = [0.3, -0.2, 0.9, 0.1, 0.4]
    interval = estimate(values)
    assert interval is not None
    low, high = student.interval(0.9, 4, np.mean(values), np.std(values, ddof=1) / np.sqrt(5))
    assert (interval.count, interval.largest) == (5, 0.9)
    assert (interval.low, interval.high) == pytest.approx((low, high))


def test_one_value_has_no_interval_and_none_no_estimate() -> None:
    interval = estimate([2.0])
    assert interval is not None
    assert (interval.mean, interval.low, interval.high) == (2.0, None, None)
    assert estimate([]) is None


def test_a_ratio_is_a_geometric_mean() -> None:
    interval = ratio([2.0, 1.0, 8.0], [1.0, 2.0, 4.0])
    assert interval["mean"] == pytest.approx(2 ** (1 / 3), abs=1e-4)
    assert interval["largest"] == 2.0
