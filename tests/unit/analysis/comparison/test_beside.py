import numpy as np
import pytest
from scipy.stats import spearmanr

from tests.planted_tables import X, planted_table
from valerie.analysis.claims.claims import parse_claims
from valerie.analysis.comparison.beside import ComparedRun, put_beside
from valerie.analysis.rows.design import Design
from valerie.analysis.rows.table import EvaluationTable
from valerie.errors import InvalidInput

PLACES = 60


def side(name: str, pacc: np.ndarray, scenes: list[str], **columns: object) -> ComparedRun:
    plain = planted_table(pacc, range(len(pacc)), frame_id=[f"{name}.{k}" for k in range(len(pacc))], **columns)
    where = np.array([int(scene.partition("/")[0]) for scene in scenes], np.float64)
    sun = [float(scene.partition("/")[2]) for scene in scenes]
    kept = {column: plain.arrow[column] for column in plain.arrow.column_names if column != X}
    parameters = {X: "FLOAT", "scene.sun-1.azimuth": "ANGLE"}
    designs = {"planted": Design((("grid", len(pacc)),))}
    table = EvaluationTable.from_columns(kept | {X: where, "scene.sun-1.azimuth": sun}, parameters, designs)
    return ComparedRun(name, name, table, np.array(scenes, dtype=object))


SCENES = [f"{place}/{sun}" for place in range(PLACES) for sun in (120, 210)]


def scores(sun_effect: float, shift: float, seed: int) -> np.ndarray:
    generator = np.random.default_rng(seed)
    base = np.repeat(np.random.default_rng(0).uniform(0.4, 0.7, PLACES), 2)
    return np.clip(base + np.tile([0.0, sun_effect], PLACES) + shift + generator.normal(0, 0.02, 2 * PLACES), 0, 1)


def test_rows_are_paired_by_scene_whatever_their_order_and_names() -> None:
    here = scores(0.0, 0.0, 1)
    there = scores(0.0, -0.1, 2)
    order = np.random.default_rng(3).permutation(len(SCENES))[:80]
    comparison = put_beside(
        side("a", here, SCENES, function="net"),
        side("b", there[order], [SCENES[k] for k in order], function="other", sensor="dusk"),
    )
    (function,) = comparison.functions  # a single function and sensor setting are the same, whatever they are called
    whole = function.slices[0]
    assert (comparison.frames, comparison.frames_here, comparison.frames_there, whole.pairs) == (80, 120, 80, 80)
    before, after = here[order], there[order]
    assert whole.here == pytest.approx(before.mean(), abs=1e-9)
    assert whole.there == pytest.approx(after.mean(), abs=1e-9)
    assert function.rank_correlation == pytest.approx(spearmanr(before, after).statistic)
    assert function.fidelity.only_there == int(((before >= 0.5) & (after < 0.5)).sum())
    assert function.fidelity.share == pytest.approx(((before < 0.5) == (after < 0.5)).mean())
    assert whole.difference.judgement == "worse"
    assert whole.difference.low is not None
    assert whole.difference.low < -0.1 < whole.difference.high < 0
    largest = order[np.argmin(after - before)]
    assert function.fell[0].frame_here == f"a.{largest}"
    assert function.fell[0].frame_there == f"b.{int(np.flatnonzero(order == largest)[0])}"


def test_every_varied_parameter_has_its_slices_and_equal_groups_count_once() -> None:
    pacc = scores(0.0, 0.0, 1)
    changed = pacc - np.tile([0.0, 0.2], PLACES)  # at 210°
    (function,) = put_beside(side("a", pacc, SCENES), side("b", changed, SCENES)).functions
    slices = {part.name: part for part in function.slices}
    judged = {name: part.difference.judgement for name, part in slices.items() if "azimuth" in name}
    assert judged == {"sun-1.azimuth 120°": "", "sun-1.azimuth 210°": "worse"}
    assert sum(name.startswith("person-1.pos.x") for name in slices) == 4
    # One distance and no occlusion: the only band is all persons.
    assert [part.pairs for part in function.slices].count(len(SCENES)) == 1


def test_a_claim_that_only_one_run_shows_is_named() -> None:
    claim = {"id": "sun", "says": "The sun helps.",
             "difference": {"factor": "sun-1.azimuth", "first": "210°", "second": "120°", "sign": ">"}}  # fmt: skip
    claims = parse_claims({"title": "A paper", "claims": [claim]})

    def answer(effect_there: float) -> tuple[str, bool]:
        comparison = put_beside(
            side("a", scores(0.1, 0, 1), SCENES), side("b", scores(effect_there, 0, 2), SCENES), claims=claims
        )
        (conclusion,) = comparison.conclusions
        return conclusion.agreement, conclusion.decided

    assert answer(0.1) == ("holds in both", True)
    assert answer(-0.1) == ("holds only here", True)
    assert answer(0.0) == ("not decided there", False)


def test_runs_without_a_common_scene_are_refused() -> None:
    with pytest.raises(InvalidInput, match="share no scene"):
        put_beside(side("a", scores(0, 0, 1)[:2], SCENES[:2]), side("b", scores(0, 0, 1)[:2], SCENES[2:4]))
