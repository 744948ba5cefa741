import json
import re
from dataclasses import asdict

import numpy as np
import pytest

from valerie.analysis.rows.design import Design
from valerie.analysis.rows.table import MOST_BLOCKS, EvaluationTable
from valerie.analysis.summary.summary import Summary, summarize
from valerie.analysis.summary.text import summary_text
from valerie.errors import InvalidInput
from valerie.plain import typed
from valerie.statistics.intervals import Refusal, mean_interval
from valerie.statistics.units import Estimand, sampling_units

BASE = {
    "run_id": "r", "variant_index": 0, "camera": "camera-1", "character": "black-outfit", "sensor": "default",
    "function": "net", "instance_id": 24001, "occlusion_rate": 0.0, "distance_m": 20.0, "pixel_accuracy": 0.9,
    "undefined_reason": None,
}  # fmt: skip


def row(frame, tp, fn, fp, frame_tp=None, frame_fn=None, **more):
    frame_tp, frame_fn = tp if frame_tp is None else frame_tp, fn if frame_fn is None else frame_fn
    called, union = frame_tp + fp, frame_tp + fp + frame_fn
    return {
        **BASE,
        "frame_id": frame,
        "tp": tp,
        "fn": fn,
        "fp": fp,
        "pacc": tp / (tp + fn) if tp + fn else None,
        "precision": frame_tp / called if called else None,
        "iou": frame_tp / union if union else None,
        **more,
    }


def hidden(frame, fp=0, **more):
    return row(frame, 0, 0, fp, undefined_reason="fully hidden", occlusion_rate=1.0, **more)


def table_of(*rows):
    return EvaluationTable.from_rows(rows, {})


def only(summary, character="black-outfit"):
    (group,) = [r for r in summary.rows if r.character == character]
    return group


def test_means_weight_persons_equally_and_pooled_counts_weight_pixels_equally():
    group = only(summarize(table_of(row("a", 90, 10, 10), row("b", 0, 20, 0), row("c", 300, 100, 0))))

    assert group.pacc_mean == pytest.approx((0.9 + 0 + 0.75) / 3)
    assert group.pacc_pooled == pytest.approx(390 / 520)
    assert (group.pacc_min, group.pacc_max) == (0.0, 0.9)
    assert group.precision_mean == pytest.approx((0.9 + 1.0) / 2)  # frame b calls nothing person
    assert group.precision_pooled == pytest.approx(390 / 400)
    assert group.iou_mean == pytest.approx((90 / 110 + 0 + 0.75) / 3)
    assert group.iou_pooled == pytest.approx(390 / 530)


def test_an_undefined_person_is_counted_with_its_reason_and_never_as_zero():
    group = only(summarize(table_of(row("a", 90, 10, 0), hidden("b"), hidden("c"))))

    assert (group.frames, group.persons, group.defined) == (3, 3, 1)
    assert group.undefined == {"fully hidden": 2}
    assert group.pacc_mean == group.pacc_min == 0.9


def test_the_detection_rate_is_the_share_of_defined_persons_that_reach_the_threshold():
    table = table_of(row("a", 50, 50, 0), row("b", 49, 51, 0), row("c", 90, 10, 0), hidden("d"))
    group = only(summarize(table, threshold=0.5))

    assert (group.detected, group.defined) == (2, 3)
    assert group.detection_rate == pytest.approx(2 / 3)
    assert only(summarize(table, threshold=0.95)).detected == 0


def test_a_function_without_a_defined_pacc_has_counts_but_no_means():
    group = only(summarize(table_of(hidden("a"), hidden("b"))))

    assert group.pacc_mean is group.pacc_pooled is group.detection_rate is group.pacc_mean_interval is None
    assert group.undefined == {"fully hidden": 2}


def test_characters_are_listed_and_then_taken_together():
    table = table_of(row("a", 90, 10, 0), row("b", 40, 60, 0, character="yellow-shirt"))
    summary = summarize(table)

    assert [r.character for r in summary.rows] == ["black-outfit", "yellow-shirt", "all"]
    assert only(summary, "yellow-shirt").pacc_mean == pytest.approx(0.4)
    assert only(summary, "all").pacc_mean == pytest.approx(0.65)


def test_two_persons_of_one_frame_share_its_false_positives_once():
    frame = {"frame_tp": 120, "frame_fn": 80}
    table = table_of(
        row("a", 90, 10, 30, **frame), row("a", 30, 70, 30, instance_id=24002, character="yellow-shirt", **frame)
    )
    group = only(summarize(table), "all")

    assert (group.frames, group.persons) == (1, 2)
    assert group.precision_pooled == group.precision_mean == pytest.approx(120 / 150)
    assert group.iou_pooled == pytest.approx(120 / 230)


def test_occlusion_counts_each_person_of_each_frame_once_for_all_functions():
    rows = [
        row("a", 9, 1, 0),
        row("b", 9, 1, 0, occlusion_rate=0.05),
        row("c", 9, 1, 0, occlusion_rate=0.3),
        hidden("d"),
    ]
    both = [*rows, *({**r, "function": "other"} for r in rows)]
    (share,) = summarize(table_of(*both)).occlusion

    assert (share.character, share.persons, share.occluded) == ("black-outfit", 4, 2)
    assert share.share == 0.5


def test_frames_without_a_person_are_summarized_separately():
    nobody = {"instance_id": None, "character": None, "undefined_reason": "absent", "occlusion_rate": None}
    summary = summarize(table_of(row("a", 90, 10, 5), row("b", 0, 0, 7, **nobody), row("c", 0, 0, 0, **nobody)))

    assert [r.character for r in summary.rows] == ["black-outfit"]
    (empty,) = summary.empty
    assert (empty.frames, empty.with_false_positives, empty.false_positive_pixels) == (2, 1, 7)
    assert only(summary).precision_pooled == pytest.approx(90 / 95)


def test_sensors_and_functions_are_never_mixed():
    table = table_of(row("a", 90, 10, 0), row("a", 20, 80, 0, sensor="dark"), row("a", 70, 30, 0, function="other"))
    group = {(r.function, r.sensor): r.pacc_mean for r in summarize(table).rows}

    assert group == {("net", "dark"): 0.2, ("net", "default"): 0.9, ("other", "default"): 0.7}


def test_a_listed_grid_has_a_spread_over_places_and_no_interval(dropping_table):
    places = {}
    for row in dropping_table.arrow.to_pylist():
        if row["function"] == "a-net" and row["pacc"] is not None:
            place = row["scene.person-1.pos.x"], row["scene.person-1.pos.y"]
            places.setdefault(place, []).append(row["pacc"])
    means = [np.mean(values) for values in places.values()]
    group = next(row for row in summarize(dropping_table).rows if (row.function, row.character) == ("a-net", "all"))

    for refusal in (group.pacc_mean_interval, group.pacc_pooled_interval, group.detection_interval):
        assert isinstance(refusal, Refusal)
        assert refusal.estimand is Estimand.LISTED_GRID
    assert group.pacc_mean_spread is not None
    assert group.pacc_mean_spread.places == 150
    assert [group.pacc_mean_spread.low, group.pacc_mean_spread.high] == pytest.approx(np.quantile(means, [0.1, 0.9]))
    text = summary_text(summarize(dropping_table))
    assert "how much places differ" in text
    assert "No confidence interval: the variants are listed" in text


def drawn(rows, parameters, design="random"):
    return EvaluationTable.from_rows(rows, parameters, {"run-1": Design(((design, 300),))})


def test_a_drawn_design_has_the_interval_of_whole_variants(dropping_table):
    table = drawn(dropping_table.arrow.to_pylist(), dropping_table.parameters)
    chosen = table.codes("function").where("a-net") & np.isfinite(table.numbers("pacc"))
    pixels = (table.numbers("tp") + table.numbers("fn"))[chosen]
    values, units = (
        table.numbers("pacc")[chosen],
        sampling_units("random", table.numbers("variant_index")[chosen].astype(int)),
    )
    group = next(
        row for row in summarize(table, threshold=0.7).rows if (row.function, row.character) == ("a-net", "all")
    )

    assert group.pacc_mean_interval == mean_interval(values, units)
    assert group.pacc_pooled_interval == mean_interval(values, units, weights=pixels)
    assert group.detection_interval == mean_interval(values >= 0.7, units)
    assert group.pacc_mean_interval.units == 300
    assert group.pacc_mean_spread is group.detection_spread is None
    assert "[95 % interval] for the space that the design draws from, from 300 variants." in summary_text(
        summarize(table)
    )


def test_replicates_of_a_sobol_design_narrow_its_interval(dropping_table):
    rows, parameters = dropping_table.arrow.to_pylist(), dropping_table.parameters
    group = next(row for row in summarize(drawn(rows, parameters, "sobol")).rows if row.character == "all")

    assert "8 replicates" in group.pacc_mean_interval.method


def test_too_few_units_are_refused_with_the_number_that_would_do(synthetic, parameters):
    rows = synthetic(lambda *_: 0.5, xs=[0.0], ys=[5.0, 9.0], functions=("net",))
    summary = summarize(drawn(rows, parameters))

    assert summary.rows[-1].pacc_mean_interval.more_units == 2
    assert "No confidence interval: 4 variants are too few; 2 more would do." in summary_text(summary)


@pytest.mark.parametrize("threshold", [0.0, 1.1, -1, float("nan")])
def test_a_threshold_out_of_bounds_is_refused(threshold):
    with pytest.raises(InvalidInput) as caught:
        summarize(table_of(row("a", 1, 1, 0)), threshold=threshold)
    assert caught.value.field == "detection_threshold"


def test_a_summary_survives_json(dropping_table):
    summary = summarize(dropping_table)

    assert typed(Summary, json.loads(json.dumps(asdict(summary)))) == summary
    summary = summarize(drawn(dropping_table.arrow.to_pylist(), dropping_table.parameters))
    assert typed(Summary, json.loads(json.dumps(asdict(summary)))) == summary


def test_an_empty_table_has_an_empty_summary():
    summary = summarize(EvaluationTable.from_rows([], {}))

    assert (summary.frames, summary.rows, summary.occlusion, summary.empty) == (0, (), (), ())
    assert "No person was evaluated" in summary_text(summary)


def test_the_text_shows_every_number_of_the_table():
    text = summary_text(summarize(table_of(row("a", 90, 10, 10), row("b", 0, 20, 0), hidden("c")), threshold=0.4))

    for part in ("net", "black-outfit", "45.0", "0.0", "90.0", "75.0", "≥ 0.4", "1 fully hidden"):
        assert part in text
    assert max(map(len, text.splitlines())) <= 140


@pytest.mark.parametrize("width", [80, 100, 140])
def test_no_number_is_cut_whatever_the_width_of_the_terminal(width, dropping_table):
    wide, text = (
        summary_text(summarize(dropping_table), width=1000),
        summary_text(summarize(dropping_table), width=width),
    )

    assert max(map(len, text.splitlines())) <= width
    assert "…" not in text
    for line in wide.split("In per cent")[0].splitlines():
        for number in re.findall(r"\d+\.\d(?: \[\d+–\d+\]| / \d+\.\d)?|\d+ (?:fully|outside)", line):
            assert number in text


def test_names_in_the_text_are_not_markup():
    text = summary_text(summarize(table_of(row("a", 9, 1, 0, function="[red]net[/red]"))))

    assert "[red]net[/red]" in text
    assert np.all([ord(c) != 27 for c in text])


def test_a_function_that_never_predicts_a_person_is_told_first():
    rows = [
        row("a", 0, 10, 0),
        row("b", 0, 20, 0),
        row("a", 0, 10, 1, function="poor"),
        row("b", 0, 20, 0, function="poor"),
    ]
    (warning,) = summarize(table_of(*rows)).warnings
    assert warning.startswith("net never predicts a person: it calls no pixel of 2 pictures person")
    assert summarize(table_of(hidden("a"), hidden("b"))).warnings == ()  # there is no person to predict


def test_pictures_without_content_are_counted_once_each_and_stay_in_every_rate():
    levels = {"dark": (0.05, 0.4), "bright": (254.6, 1.2), "grey": (128.0, 0.0), "good": (90.0, 40.0)}
    rows = [
        row(frame, 5, 5, 0, function=function, picture_mean=mean, picture_deviation=deviation)
        for frame, (mean, deviation) in levels.items()
        for function in ("net", "other")
    ]
    summary = summarize(table_of(*rows, row("uploaded", 5, 5, 0)))
    advice = " Where the exposure is fixed, auto_exposure: true meters it."
    assert summary.warnings == (
        f"1 of 4 pictures is black (frames dark).{advice}",
        f"1 of 4 pictures is white (frames bright).{advice}",
        "1 of 4 pictures is constant (frames grey).",
    )
    assert {group.frames for group in summary.rows} == {4, 5}
    many = summarize(table_of(*(row(f"f{i}", 5, 5, 0, picture_mean=0.1, picture_deviation=0.1) for i in range(5))))
    assert many.warnings == (f"5 of 5 pictures are black (frames f0, f1, f2, …).{advice}",)
    assert typed(Summary, json.loads(json.dumps(asdict(many)))) == many


def test_the_rows_of_two_blocks_say_what_they_mix():
    rows = [row(f"f{i}", 5, 5, 0, variant_index=i, character="red" if i < 3 else "blue") for i in range(4)]
    rows.append(row("f4", 5, 5, 0, variant_index=4, character="blue"))
    two = EvaluationTable.from_rows(rows, {}, {"r": Design((("grid", 4), ("grid", 1)))})
    sentence = next(line for line in summary_text(summarize(two), width=1000).splitlines() if "block" in line)
    assert "all together are 80.0 % of block 1 (blue, red), 20.0 % of block 2 (blue). " in sentence
    many = [row(f"f{i}", 5, 5, 0, variant_index=i) for i in range(20)]
    blocks = summarize(EvaluationTable.from_rows(many, {}, {"r": Design((("grid", 1),) * 20)}))
    assert len(blocks.blocks) == MOST_BLOCKS
    assert "5.0 % of block 8 (black-outfit), 60.0 % of others. " in summary_text(blocks, width=1000)
    one = EvaluationTable.from_rows(rows, {}, {"r": Design((("grid", 5),))})
    assert "block" not in summary_text(summarize(one))
