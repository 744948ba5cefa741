"""The gate on planted tables, and its result as JUnit XML."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.stats import ttest_1samp

from tests.planted_tables import X, drawn, planted_table, requirement
from valerie.analysis.verdicts.gate import GateRun, gate, places_before, slice_text
from valerie.analysis.verdicts.junit import junit_xml
from valerie.analysis.verdicts.verdicts import RequirementVerdict, judge_requirements
from valerie.errors import Conflict, InvalidInput, UnknownName
from valerie.perception.base import FunctionCard
from valerie.runs.products.pins import BOUNDS, FunctionPin, InferClass, Offer, Pins, RenderClass, TolerantPins
from valerie.runs.products.states import Stage
from valerie.runs.resolving.spec import RunSpec, parse
from valerie.statistics.gates import places_for_gate

CLASS = "cpu-1"


def pins(functions: Sequence[str], infer_class: str = CLASS) -> Pins:
    engine = Offer(stage=Stage.RENDER, name="raster", numeric_class=CLASS, revision=1, route="r")
    card = FunctionCard("net", "d", "net", "fp32", "e", {})
    pin = FunctionPin(
        stage=Stage.INFER, name="net", numeric_class=infer_class, revision=1, route="r", digest="d", card=card
    )
    return Pins(engine=engine, truth=engine, functions=dict.fromkeys(functions, pin))


def spec(functions: Sequence[str] = ("net",), **more: Any) -> RunSpec:
    drawn = {"design": "random", "count": 200, "vary": [["x", "UNIFORM", 0, 1000]]}
    return parse({"name": "n", "asset": "a", "functions": list(functions), **drawn, **more})


def run(
    scores: dict[str, Any], *, name: str = "r1", verdicts: tuple[RequirementVerdict, ...] = (), infer_class: str = CLASS,
    asset_digest: str = "asset", columns: Any = (), **more: Any,
) -> GateRun:  # fmt: skip
    """Return a run of several functions on the same variants, each with a score for every variant."""
    count = len(next(iter(scores.values())))
    table = planted_table(
        np.concatenate(list(scores.values())),
        np.tile(np.arange(count), len(scores)),
        function=np.repeat(list(scores), count).tolist(),
        design=drawn(more.get("design", "random"), count),
        frame_id=[f"{name}.{variant}.0.0" for variant in range(count)] * len(scores),
        **{key: np.tile(column, len(scores)) for key, column in dict(columns).items()},
    )
    return GateRun(name, spec(tuple(scores), **more), asset_digest, pins(tuple(scores), infer_class), table, verdicts)


def planted(seed: int = 0, count: int = 200) -> tuple[np.ndarray, np.ndarray]:
    """Return scores of a baseline, and of a version that is worse by 10 points beyond 20 m alone."""
    rng = np.random.default_rng(seed)
    distance = np.where(np.arange(count) % 2, 15.0, 25.0)
    before = rng.uniform(0.6, 0.8, count)
    after = before + rng.normal(0, 0.05, count) - 0.1 * (distance > 20)
    return before, after


DISTANCE = {"distance_m": np.where(np.arange(200) % 2, 15.0, 25.0)}


def test_a_function_that_became_worse_somewhere_is_found_there_alone() -> None:
    before, after = planted()
    result = gate(run({"old": before, "new": after}, columns=DISTANCE), "old")
    (version,) = result.versions
    assert (version.version, version.baseline, version.unmatched) == ("new", "old", 0)
    assert "distance 20–30 m" in version.gate.worse
    assert "distance 10–20 m" not in version.gate.worse
    assert not result.passed
    far = next(item for item in version.gate.slices if item.name == "distance 20–30 m")
    change = (np.round(after * 1000) / 1000 - before)[DISTANCE["distance_m"] > 20]
    assert far.difference == pytest.approx(change.mean(), abs=1e-3)
    assert far.t_p == pytest.approx(ttest_1samp(change, 0, alternative="less").pvalue, rel=0.2)
    slices = len(version.gate.slices)
    assert far.places_needed == places_for_gate(0.05, change.std(ddof=1), slices)
    near = next(item for item in version.gate.slices if item.name == "distance 10–20 m")
    assert "places" in slice_text(near, 0.05).partition(";")[2]
    assert not slice_text(far, 0.05).partition(";")[2]  # it was found: no number of places is wanting


def test_a_comparison_with_too_few_places_everywhere_is_undecided_and_does_not_pass() -> None:
    rng = np.random.default_rng(1)
    before = rng.uniform(0.4, 0.8, 12)
    after = before + rng.choice([-0.15, 0.15], 12)
    runs = run({"old": before, "new": after})
    result = gate(runs, "old")
    (version,) = result.versions
    assert (version.gate.worse, version.undecided, result.passed) == ((), True, False)
    assert result.to_json()["versions"][0]["undecided"] is True
    assert b'type="undecided"' in junit_xml(result)
    allowed = gate(runs, "old", allow_undecided=True)
    assert allowed.passed
    assert b"<failure" not in junit_xml(allowed)


def test_the_same_run_is_nowhere_worse_than_itself_or_another_run_on_the_same_frames() -> None:
    before, _ = planted()
    one, other = run({"net": before}), run({"net": before}, name="r2", detection_threshold=0.3)
    result = gate(one, other)
    assert result.passed
    assert [v.baseline for v in result.versions] == ["net of run r2"]
    assert {item.difference for item in result.versions[0].gate.slices} == {0.0}


def test_versions_of_a_name_are_compared_across_runs_and_a_single_function_with_a_single_one() -> None:
    before, after = planted()
    baseline = run({"a@1": before, "b": before}, name="r2")
    versions = gate(run({"b": before, "a@2": after}), baseline).versions
    assert [(v.version, v.baseline) for v in versions] == [("b", "b of run r2"), ("a@2", "a@1 of run r2")]
    (single,) = gate(run({"x": before}), run({"y": before}, name="r2")).versions
    assert (single.version, single.baseline) == ("x", "y of run r2")
    (chosen,) = gate(run({"b": before, "a@2": after}), baseline, function="b").versions
    assert chosen.version == "b"
    (named,) = gate(run({"b": before, "a@2": after}), "a").versions  # the only version of its name
    assert (named.version, named.baseline) == ("b", "a@2")
    with pytest.raises(UnknownName, match="unknown function of the run 'a'"):
        gate(run({"a@1": before, "a@2": after}), "a")


def test_rows_that_one_run_lacks_are_counted() -> None:
    before, _ = planted()
    short = run({"net": before[:150]}, name="r2")
    (version,) = gate(run({"net": before}), short).versions
    assert version.unmatched == 50
    assert version.gate.slices[0].pairs == 150


def test_places_of_a_grid_are_positions_and_of_a_drawn_design_variants() -> None:
    before, after = planted()
    position = {X: np.repeat(np.arange(20.0), 10)}
    grid = {"design": "grid", "count": None, "vary": [["x", "HOMOGENEOUS", 0, 199, 1]]}
    places = [
        gate(run({"old": before, "new": after}, columns=position, **design), "old").versions[0].gate.slices[0].places
        for design in ({}, grid)
    ]
    assert places == [200, 20]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"seed": 3}, "what differs: seed"),
        ({"asset_digest": "other"}, "what differs: asset"),
        ({"cameras": ["c"]}, "cameras"),
    ],
)
def test_a_baseline_on_other_frames_is_refused(change: dict[str, Any], words: str) -> None:
    before, _ = planted()
    with pytest.raises(InvalidInput, match=words):
        gate(run({"net": before}), run({"net": before}, name="r2", **change))


def test_unequal_numeric_classes_are_compared_on_request_alone() -> None:
    before, _ = planted()
    one, other = run({"net": before}), run({"net": before}, name="r2", infer_class="cpu-2")
    with pytest.raises(Conflict, match="numeric class of their inference: cpu-1 and cpu-2"):
        gate(one, other)
    assert gate(one, other, mixed=True).passed


def test_runs_that_accept_several_classes_are_compared_if_they_are_split_alike() -> None:
    before, _ = planted()

    def accepting(name: str, *workers: int) -> GateRun:
        own = run({"net": before}, name=name, reproducible="tolerance")
        classes = [pins(["net"], f"cpu-{number}").functions for number in range(1, 1 + len(workers))]
        return replace(
            own,
            pins=TolerantPins(
                **dict(own.pins),
                render=(RenderClass(engine=own.pins.engine, truth=own.pins.truth, workers=1),),
                infer=tuple(InferClass(functions=one, workers=n) for one, n in zip(classes, workers, strict=True)),
                place=("x",),
                bounds=BOUNDS,
            ),
        )

    assert gate(accepting("r1", 1, 3), accepting("r2", 1, 3)).passed
    for other in (accepting("r2", 1, 2), run({"net": before}, name="r2")):
        with pytest.raises(Conflict, match=r"cpu-1 \(weight 1\) or cpu-2 \(weight 3\)"):
            gate(accepting("r1", 1, 3), other)
        assert gate(accepting("r1", 1, 3), other, mixed=True).passed


def test_what_cannot_be_compared_is_refused_by_name() -> None:
    before, _ = planted()
    baseline = run({"net": before})
    with pytest.raises(InvalidInput, match="no requirements, and there is no baseline"):
        gate(baseline)
    with pytest.raises(UnknownName, match=r"--baseline.*did you mean net"):
        gate(baseline, "nett")
    with pytest.raises(UnknownName, match=r"--function.*did you mean net"):
        gate(baseline, baseline, function="nett")
    with pytest.raises(InvalidInput, match="no other function"):
        gate(baseline, "net")


def verdicts() -> tuple[RequirementVerdict, ...]:
    table, space = planted_table([0.9] * 12, range(12)), drawn("random", 12)
    required = [
        requirement("mean(pacc) >= 0.2", id="MET", text="good \x07 & <fine>"),
        requirement("mean(pacc) <= 0.2", id="NOT"),
        requirement("share(pacc >= 0.5) >= 0.95", id="OPEN"),
    ]
    return judge_requirements(required, table, space)


def test_requirements_that_are_not_met_fail_and_undecided_ones_unless_they_are_allowed() -> None:
    met, missed, undecided = verdicts()
    before, _ = planted()
    for given, strict, lenient in (
        ((met,), True, True),
        ((met, undecided), False, True),
        ((met, missed), False, False),
    ):
        baseline = run({"net": before}, verdicts=given)
        assert gate(baseline).passed == strict
        assert gate(baseline, allow_undecided=True).passed == lenient


@pytest.mark.parametrize("lenient", [False, True])
def test_junit_xml_has_a_case_for_every_requirement_and_slice(lenient: bool) -> None:
    before, after = planted()
    gate_run = run({"old": before, "new": after}, columns=DISTANCE, verdicts=verdicts())
    result = gate(gate_run, "old", allow_undecided=lenient)
    root = ET.fromstring(junit_xml(result))  # written by this test
    first, second = root
    assert first.attrib == {
        "name": "requirements", "tests": "3", "failures": "1" if lenient else "2", "skipped": "1" if lenient else "0",
        "errors": "0",
    }  # fmt: skip
    outcomes = {case.get("name"): [part.tag for part in case if part.tag != "system-out"] for case in first}
    assert outcomes == {"MET": [], "NOT": ["failure"], "OPEN": ["skipped" if lenient else "failure"]}
    assert "mean pACC" in first.findtext("testcase/system-out", "")
    worse = [case.get("name") for case in second if case.find("failure") is not None]
    assert worse == list(result.versions[0].gate.worse)
    skipped = [case.get("name") for case in second if case.find("skipped") is not None]
    assert skipped == [item.name for item in result.versions[0].gate.slices if item.too_few and not item.worse]
    assert second.get("name") == "new against old"
    assert int(second.get("tests", "")) == len(result.versions[0].gate.slices)
    assert junit_xml(result) == junit_xml(result)


def test_cases_of_two_pipelines_have_equal_classes_and_names() -> None:
    before, after = planted()
    cases = []
    for number in ("1", "2"):
        this = run(
            {"net@0": before, f"net@{number}": after}, name=f"run-{number}", columns=DISTANCE, verdicts=verdicts()
        )
        root = ET.fromstring(junit_xml(gate(this, "net@0")))  # written by this test
        cases.append([(case.get("classname"), case.get("name")) for case in root.iter("testcase")])
    assert cases[0] == cases[1]
    assert len(set(cases[0])) == len(cases[0])
    both = run({"base": before, "net@1": after, "net@2": after}, columns=DISTANCE)
    root = ET.fromstring(junit_xml(gate(both, "base")))
    assert {case.get("classname") for case in root.iter("testcase")} == {"comparison.net@1", "comparison.net@2"}


def test_one_pair_at_one_place_is_singular() -> None:
    alone = gate(run({"old": np.array([0.9]), "new": np.array([0.8])}), "old").versions[0].gate
    assert "1 pair at 1 place," in slice_text(alone.slices[0], 0.05)


def test_the_result_is_json_without_nan() -> None:
    before, _ = planted()
    document = gate(run({"old": before, "new": before}, verdicts=verdicts()), "old").to_json()
    text = json.dumps(document, allow_nan=False)
    assert json.loads(text)["passed"] is False


def test_the_number_of_places_is_said_before_a_version_is_run() -> None:
    before, after = planted()
    both = run({"old": before, "new": after}, columns=DISTANCE)
    need = places_before(both, function="old", effect=0.1)[0]
    change = np.round(after * 1000) / 1000 - np.round(before * 1000) / 1000  # each variant is a place
    assert need.deviation == pytest.approx(change.std(ddof=1), abs=1e-3)
    assert need.slices["all"] == 200
    assert need.slices["distance 20–30 m"] == need.slices["distance 10–20 m"] == 100
    assert need.needed == places_for_gate(0.1, need.deviation, len(need.slices))
    assert need.too_few == {name: places for name, places in need.slices.items() if places < (need.needed or 0)}
    alone = run({"old": before}, columns=DISTANCE)
    (told,) = places_before(alone, effect=0.01, deviation=0.2)
    assert told.needed == places_for_gate(0.01, 0.2, len(told.slices))
    assert told.too_few == told.slices
    with pytest.raises(InvalidInput, match="--deviation"):
        places_before(alone)


def test_places_said_before_are_enough_for_the_gate() -> None:
    """The gate finds a planted drop in at least 90 % of versions; one-sided 0.1 % of Binomial(200, 0.9) is 165."""
    (need,) = places_before(run({"old": planted()[0]}), effect=0.05, deviation=0.1)
    assert need.needed is not None
    detections = 0
    for seed in range(200):
        rng = np.random.default_rng(seed)
        baseline = rng.uniform(0.4, 0.8, need.needed)
        version = baseline + rng.normal(-0.05, 0.1, need.needed)
        places = run({"old": baseline, "new": np.clip(version, 0, 1)})
        detections += "all" in gate(places, "old").versions[0].gate.worse
    assert detections >= 165
