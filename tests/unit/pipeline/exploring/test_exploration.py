"""Explorations against the same questions asked row by row in Python."""

from __future__ import annotations

import numpy as np
import pytest

from tests.planted_tables import X, drawn, planted_table
from valerie.analysis.rows.design import Design
from valerie.analysis.rows.table import EvaluationTable
from valerie.errors import InvalidInput, UnknownName
from valerie.pipeline.exploring import linked_views
from valerie.pipeline.exploring.exploration import Exploration
from valerie.pipeline.exploring.pairs import Comparison, PairOutcome, Side, compare_sides, largest_swings
from valerie.runs.resolving.where import compile_where
from valerie.statistics.intervals import Interval
from valerie.statistics.units import Estimand

VARIANTS = 60


@pytest.fixture(scope="module")
def explored() -> Exploration:
    """Two functions behind two cameras; a tenth of the rows has no pACC, and some no occlusion."""
    generator = np.random.default_rng(3)
    count = VARIANTS * 4
    pacc = np.round(generator.random(count), 3)
    pacc[::10] = np.nan
    return Exploration(
        planted_table(
            pacc,
            np.repeat(np.arange(VARIANTS), 4),
            design=drawn("random", VARIANTS),
            function=["net", "other"] * (count // 2),
            camera=["camera-1", "camera-1", "camera-2", "camera-2"] * (count // 4),
            distance_m=np.round(5 + 40 * generator.random(count), 2),
            occlusion_rate=np.where(generator.random(count) < 0.3, np.nan, generator.random(count)),
        )
    )


@pytest.mark.parametrize(
    "text",
    [
        "pacc < 0.5",
        "not pacc < 0.5",
        "pacc < 0.5 or distance_m > 25",
        "not (pacc < 0.5 and occlusion_rate > 0.2)",
        "pacc is undefined and not (occlusion_rate is undefined)",
        "10 <= distance_m < 20 and function == 'net'",
        "function != \"net\" and camera == 'camera-2' or person-1.pos.x == 3",
        "distance_m / (variant_index - 3) > 2 or -distance_m + 2 * pacc > -6",
        "(distance_m × 2 − 1) ÷ 3 >= 10",
        "undefined_reason == 'fully hidden'",
    ],
)
def test_an_expression_selects_the_rows_for_which_it_holds(explored: Exploration, text: str) -> None:
    choices = {"function": ["net", "other"], "camera": ["camera-1", "camera-2"]}
    rows = explored.table.arrow.to_pylist()
    text_of_paths = text.replace("person-1.pos.x", "depth_m")  # the oracle knows no parameters of this run
    rows = [{**row, "depth_m": row[X]} for row in rows]
    where = compile_where(text_of_paths, choices=choices)
    assert explored.select(text).rows.tolist() == [where.holds(row) for row in rows]


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("nope < 1", "'nope'"),
        ("camera > 3", "camera > 3"),
        ("camera == 'camera-9'", "camera-9"),
        ("pacc <", "ends too early"),
        ("pacc < 1; DROP TABLE rows", "';'"),
        ('"pacc" < 1', "compared"),
    ],
)
def test_what_is_no_expression_over_the_columns_is_refused(explored: Exploration, text: str, named: str) -> None:
    with pytest.raises(InvalidInput, match=r"where") as refused:
        explored.select(text)
    assert named in str(refused.value)


def test_quotes_in_a_text_stay_a_text(explored: Exploration) -> None:
    assert explored.select("frame_id == \"x' OR TRUE OR '\"").count == 0


@pytest.mark.parametrize("column", ["distance_m", "pacc", "occlusion_rate", "function", X])
def test_a_histogram_counts_every_row_once_and_its_bins_are_selected_by_their_ends(
    explored: Exploration, column: str
) -> None:
    shown = linked_views.histogram(explored, column, explored.select("distance_m > 20"))
    assert sum(shown.every) == len(explored)
    assert sum(shown.selected) == explored.select("distance_m > 20").count
    assert shown.every[-1] == explored.select(f"{column} is undefined").count
    for k, number in enumerate(shown.every[:-1]):
        if shown.levels:
            level = shown.levels[k]
            text = f"{column} == '{level}'" if isinstance(level, str) else f"{column} == {level}"
        else:
            sign = "<=" if k == len(shown.every) - 2 else "<"
            text = f"{column} >= {shown.edges[k]} and {column} {sign} {shown.edges[k + 1]}"
        assert explored.select(text).count == number, text


def test_links_are_the_pairs_of_bins_of_the_selected_rows(explored: Exploration) -> None:
    selection = explored.select("function == 'net'")
    (first, second) = linked_views.links(explored, ["camera", "pacc", "distance_m"], selection)
    assert sum(n for *_, n in first.pairs) == sum(n for *_, n in second.pairs) == selection.count
    every = linked_views.histogram(explored, "pacc", selection)
    for link, side in ((first, 1), (second, 0)):
        counted = np.bincount([pair[side] for pair in link.pairs], [pair[2] for pair in link.pairs], len(every.every))
        assert counted.tolist() == every.selected


def test_few_rows_are_points_and_a_density_holds_every_row(explored: Exploration) -> None:
    selection = explored.select("distance_m < 30")
    points = linked_views.scatter(explored, "distance_m", "pacc", "function", selection, form="auto")
    cells = linked_views.scatter(explored, "distance_m", "pacc", "function", selection, form="cells")
    drawn_rows = explored.select("distance_m < 30 and not (pacc is undefined)")
    assert points["row"].to_pylist() == np.flatnonzero(drawn_rows.rows).tolist()
    assert np.allclose(points["x"], explored.table.numbers("distance_m")[drawn_rows.rows])
    assert sum(cells["count"].to_pylist()) == drawn_rows.count
    assert int(cells.schema.metadata[b"undefined"]) == selection.count - drawn_rows.count
    with pytest.raises(InvalidInput, match="names"):
        linked_views.scatter(explored, "camera", "pacc", "", selection, form="auto")


def test_pages_are_the_sorted_rows_with_the_undefined_last(explored: Exploration) -> None:
    selection = explored.select("camera == 'camera-1'")
    pages = [explored.page(selection, sort="-pacc", limit=50, offset=k).to_pylist() for k in (0, 50, 100)]
    scores = [row["pacc"] for page in pages for row in page]
    known = [score for score in scores if score is not None]
    assert len(scores) == selection.count
    assert scores == sorted(known, reverse=True) + [None] * (len(scores) - len(known))
    names = [row["function"] for row in explored.page(explored.select(), sort="-function", limit=1000).to_pylist()]
    assert names == sorted(names, reverse=True)
    assert len(set(names)) > 1
    with pytest.raises(UnknownName, match="sort"):
        explored.page(selection, sort="frame_id; --", limit=1)


def test_the_connection_reads_no_file(explored: Exploration) -> None:
    from valerie.parameters.constraints import Sql

    with pytest.raises(Exception, match=r"disabled|Permission"):
        explored.query(Sql("SELECT * FROM read_csv('/etc/passwd')"))


def test_rates_of_selection_and_rest_are_the_means_of_their_rows(explored: Exploration) -> None:
    far_rows = explored.select("distance_m > 20").rows
    groups = linked_views.rates(explored, far_rows, ~far_rows, 0.5)
    rows = explored.table.arrow.to_pylist()
    assert [group.function for group in groups] == ["net", "other"]
    for group in groups:
        for side, far in ((group.selected, True), (group.beside, False)):
            own = [row for row in rows if row["function"] == group.function and (row["distance_m"] > 20) is far]
            known = [row["pacc"] for row in own if row["pacc"] is not None]
            assert side.persons == len(known)
            assert sum(side.undefined.values()) == len(own) - len(known)
            assert isinstance(side.pacc, Interval)
            assert side.pacc.estimate == pytest.approx(np.mean(known))
            assert side.detected.estimate == pytest.approx(np.mean([score >= 0.5 for score in known]))


def test_each_run_keeps_the_interval_of_its_own_design_or_the_reason_for_none() -> None:
    scores = np.random.default_rng(2).uniform(0.2, 0.9, 30)
    runs = {"listed": ("grid", 30), "drawn": ("random", 30), "few": ("random", 4)}
    tables = []
    for run, (kind, count) in runs.items():
        plain = planted_table(scores[:count], range(count), run_id=run)
        tables.append(EvaluationTable(plain.arrow, plain.parameters, {run: Design(((kind, count),))}))
    together, everything = Exploration(EvaluationTable.joined(tables)), np.ones(64, np.bool_)
    drawn, few, listed = linked_views.rates(together, everything, ~everything, 0.5)
    assert [drawn.run, few.run, listed.run] == ["drawn", "few", "listed"]
    for group, table in ((listed, tables[0]), (drawn, tables[1]), (few, tables[2])):
        own = np.ones(len(table), np.bool_)
        (alone,) = linked_views.rates(Exploration(table), own, ~own, 0.5)
        assert (group.selected.pacc, group.selected.why) == (alone.selected.pacc, alone.selected.why)
    assert isinstance(drawn.selected.pacc, Interval)
    assert (drawn.selected.pacc.estimand, drawn.selected.why) == (Estimand.DESIGN_BOX, "")
    assert few.selected.why == "4 variants are too few; 2 more would do"
    assert listed.selected.why.startswith("the variants are listed, not drawn at random")


def test_two_functions_are_matched_frame_by_frame(explored: Exploration) -> None:
    compared = compare_sides(
        explored, explored.select("camera == 'camera-2'"), Side("planted", "net"), Side("planted", "other"),
        threshold=0.5, outcome=PairOutcome.BROKEN, limit=1000,
    )  # fmt: skip
    rows = explored.table.arrow.to_pylist()
    pairs = [(a["pacc"], b["pacc"]) for a, b in zip(rows[::2], rows[1::2], strict=True) if a["camera"] == "camera-2"]
    # Planted frames of both cameras have one id, so each row of camera 2 meets those of both cameras.
    both = [(a["pacc"], b["pacc"]) for a in rows for b in rows
            if a["function"] == "net" and b["function"] == "other" and a["frame_id"] == b["frame_id"]
            and a["camera"] == "camera-2" and a["pacc"] is not None and b["pacc"] is not None]  # fmt: skip
    assert pairs
    assert compared.matched == len(both)
    assert compared.outcomes[PairOutcome.BROKEN] == sum(a >= 0.5 > b for a, b in both) == len(compared.pairs)
    assert compared.outcomes[PairOutcome.FIXED] == sum(a < 0.5 <= b for a, b in both)
    changes = [pair.pacc_before - pair.pacc_after for pair in compared.pairs]
    assert changes == sorted(changes, reverse=True)
    assert compared.low is not None
    assert compared.low < np.mean([b - a for a, b in both]) < compared.high  # type: ignore[operator]


def test_pairs_that_one_side_scores_lower_are_shown_though_both_sides_find_them() -> None:
    table = planted_table([0.9, 0.8, 0.9, 0.6, 0.7, 0.8], [0, 0, 1, 1, 2, 2], function=["net", "other"] * 3)
    explored = Exploration(table)
    compared = compare_sides(
        explored, explored.select(), Side("planted", "net"), Side("planted", "other"),
        threshold=0.5, outcome=PairOutcome.LOWER, limit=5,
    )  # fmt: skip
    assert [(pair.pacc_before, pair.pacc_after) for pair in compared.pairs] == [(0.9, 0.6), (0.9, 0.8)]
    counts = compared.outcomes
    assert (counts[PairOutcome.BROKEN], counts[PairOutcome.LOWER], counts[PairOutcome.HIGHER]) == (0, 2, 1)


def test_two_runs_are_matched_by_what_they_vary() -> None:
    before = planted_table([0.1, 0.9, 0.8], [0, 1, 2], run_id="a")
    # The same positions in another order, and one that the first run lacks.
    after = planted_table([0.2, 0.7, 0.6], [2, 0, 9], run_id="b")
    joined = type(before).joined([before, after])
    compared = compare_sides(
        Exploration(joined), Exploration(joined).select(), Side("a", "net"), Side("b", "net"),
        threshold=0.5, outcome=PairOutcome.FIXED, limit=5,
    )  # fmt: skip
    assert compared.rows == (3, 3)
    assert compared.matched == 2
    assert [(pair.pacc_before, pair.pacc_after) for pair in compared.pairs] == [(0.1, 0.7)]
    assert compared.outcomes[PairOutcome.BROKEN] == 1


def test_two_runs_are_matched_across_a_parameter_that_each_holds() -> None:
    sun = "scene.sun-1.elevation"

    def of_run(run: str, pacc: list[float], xs: list[float], elevations: list[float]) -> EvaluationTable:
        plain = planted_table(pacc, xs, run_id=run)
        columns = {name: plain.arrow[name] for name in plain.arrow.column_names}
        return EvaluationTable.from_columns(columns | {sun: elevations}, {X: "FLOAT", sun: "FLOAT"})

    tables = [of_run("day", [0.1, 0.9], [0, 1], [45, 45]), of_run("dusk", [0.7, 0.6], [1, 0], [5, 5]),
              of_run("both", [0.7, 0.6], [1, 0], [5, 45])]  # fmt: skip
    explored = Exploration(EvaluationTable.joined(tables))

    def compared(after: str, *across: str) -> Comparison:
        return compare_sides(
            explored, explored.select(), Side("day", "net"), Side(after, "net"),
            threshold=0.5, outcome=PairOutcome.FIXED, limit=5, across=across,
        )  # fmt: skip

    assert compared("dusk").matched == 0
    assert (compared("dusk").held, compared("both").held) == ([sun], [])
    assert [(pair.pacc_before, pair.pacc_after) for pair in compared("dusk", "sun-1.elevation").pairs] == [(0.1, 0.6)]
    assert compared("dusk", sun).matched == 2
    with pytest.raises(InvalidInput, match=r"across: no parameter .* own: sun-1.elevation; got moon"):
        compared("dusk", "moon")
    with pytest.raises(InvalidInput, match=r"across: varies inside run both; .*: none; got sun-1.elevation"):
        compared("both", "sun-1.elevation")


def test_the_largest_swing_is_between_rows_that_differ_in_one_parameter() -> None:
    table = planted_table([0.9, 0.1, 0.5, 0.6], [0, 1, 2, 3], camera=["camera-1", "camera-1", "camera-2", "camera-2"])
    explored = Exploration(table)
    swings = largest_swings(explored, explored.select(), limit=5)
    assert [(swing.parameter, swing.pair.before, swing.pair.after) for swing in swings] == [(X, 0, 1), (X, 3, 2)]
