"""Gate of a change: verdicts on a run, and its functions against a baseline on identical frames."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from valerie.analysis.rows.pairing import frames_of_any_run, levels_of, paired_rows, row_keys, rows_taken
from valerie.analysis.rows.table import EvaluationTable
from valerie.analysis.verdicts.verdicts import RequirementVerdict
from valerie.analysis.wording import ALIKE_PLACES, counted, points
from valerie.errors import Conflict, InvalidInput, UnknownName
from valerie.plain import JsonObject, json_values
from valerie.runs.document.differing import FREE, differing_fields
from valerie.runs.products.pins import Pins, inference_part, numeric_classes
from valerie.runs.resolving.spec import RunSpec
from valerie.statistics.gates import EFFECT, Gate, SliceComparison, compare_versions, places_for_gate
from valerie.statistics.verdicts import Outcome


@dataclass(frozen=True, slots=True, eq=False)
class GateRun:
    """The data of a run that the gate reads.

    Attributes:
        id: id of the run.
        spec: its spec.
        asset_digest: digest of its asset.
        pins: numeric classes of its engines and functions.
        table: its evaluations.
        verdicts: verdicts on its requirements.
    """

    id: str
    spec: RunSpec
    asset_digest: str
    pins: Pins
    table: EvaluationTable
    verdicts: tuple[RequirementVerdict, ...]


@dataclass(frozen=True, slots=True)
class VersionGate:
    """One function against its baseline.

    Attributes:
        version, baseline: the functions; the baseline with its run where it has a different one.
        gate: comparison of their pACC.
        unmatched: rows that only one of the two has.
    """

    version: str
    baseline: str
    gate: Gate
    unmatched: int

    @property
    def undecided(self) -> bool:
        """True if no slice is worse, but even all rows together have too few places to show a drop, or alike ones."""
        return not self.gate.worse and self.gate.slices[0].too_few


@dataclass(frozen=True, slots=True)
class GateResult:
    """Result of a gate.

    Attributes:
        run_id: id of the run.
        verdicts: verdicts on its requirements.
        versions: its functions against the baseline; empty without one.
        allow_undecided: True if undecided requirements and comparisons pass.
    """

    run_id: str
    verdicts: tuple[RequirementVerdict, ...]
    versions: tuple[VersionGate, ...]
    allow_undecided: bool = False

    def passes(self, verdict: RequirementVerdict) -> bool:
        """Return True if a verdict lets the change pass."""
        return verdict.outcome is Outcome.MET or (self.allow_undecided and verdict.outcome is Outcome.UNDECIDED)

    @property
    def passed(self) -> bool:
        """True if all verdicts pass, no function is worse than its baseline, and every comparison could show it."""
        return all(map(self.passes, self.verdicts)) and not any(map(self.fails, self.versions))

    def fails(self, version: VersionGate) -> bool:
        """Return True if a comparison stops the change."""
        return bool(version.gate.worse) or (version.undecided and not self.allow_undecided)

    def to_json(self) -> JsonObject:
        """Return the result as JSON values."""
        return {
            "run": self.run_id,
            "passed": self.passed,
            "allow_undecided": self.allow_undecided,
            "verdicts": list(map(asdict, self.verdicts)),
            "versions": [{**json_values(version), "undecided": version.undecided} for version in self.versions],
        }


@dataclass(frozen=True, slots=True)
class PlacesNeeded:
    """Number of places that a gate will need, said before a version is run.

    Attributes:
        function: the baseline to be.
        effect: smallest drop of pACC to detect.
        deviation: standard deviation of a place's change that is assumed.
        slices: name to number of places with a score.
        needed: places that each slice needs; None: no affordable number suffices.
    """

    function: str
    effect: float
    deviation: float
    slices: Mapping[str, int]
    needed: int | None

    @property
    def too_few(self) -> dict[str, int]:
        """Slices with fewer places than it takes."""
        return {name: places for name, places in self.slices.items() if self.needed is None or places < self.needed}


def places_before(
    run: GateRun,
    *,
    function: str | None = None,
    effect: float = EFFECT,
    deviation: float | None = None,
) -> tuple[PlacesNeeded, ...]:
    """Return how many places a gate will need with this run as its baseline.

    Args:
        run: that has ended.
        function: the only one to speak of; None: every one.
        effect: smallest drop of pACC to detect.
        deviation: standard deviation of a place's change; None: as between the function and another one of the run.

    Raises:
        InvalidInput: no deviation is given, and the run has no other function to take it from.
        UnknownName: no such function.
    """
    needs = []
    for name in run.spec.functions if function is None else (_function(function, run, "--function"),):
        table = run.table.select(run.table.codes("function").where(name))
        scored = np.isfinite(table.numbers("pacc"))
        masks = {"all": np.ones(len(table), np.bool_), **levels_of(table)}
        slices = {part: len(np.unique(table.places[mask & scored])) for part, mask in masks.items()}
        spread = _deviation(run, name) if deviation is None else deviation
        needed = places_for_gate(effect, spread, len(slices))
        needs.append(PlacesNeeded(name, effect, spread, slices, needed))
    return tuple(needs)


def _deviation(run: GateRun, function: str) -> float:
    """Return the standard deviation of places' mean differences between a function and the first other one of its run."""
    others = [name for name in run.spec.functions if name != function]
    for other in others[:1]:
        before, matched, _ = _matched(run, function, run, other)
        change = matched.numbers("pacc") - before
        known = np.isfinite(change)
        place = np.unique(matched.places[known], return_inverse=True)[1]
        means = np.bincount(place, change[known]) / np.bincount(place)
        if len(means) > 1:
            return float(means.std(ddof=1))
    raise InvalidInput(
        "the run cannot tell how much a change varies from place to place", field="--deviation",
        limit="a number between 0 and 1, or a run of two functions at two places or more",
    )  # fmt: skip


def gate(
    run: GateRun,
    baseline: GateRun | str | None = None,
    *,
    function: str | None = None,
    effect: float = EFFECT,
    false_discoveries: float = 0.05,
    mixed: bool = False,
    allow_undecided: bool = False,
) -> GateResult:
    """Judge a run by its requirements, and its functions against a baseline.

    Args:
        run: run that has ended.
        baseline: another run on the same frames, or the name of a function of this run; None: only requirements.
        function: the only function to compare; None: every one that has a baseline.
        effect: smallest drop of pACC to detect; it decides how many places are needed.
        false_discoveries: largest expected share of false ones among the slices named worse.
        mixed: also compare functions that ran in different numeric classes.
        allow_undecided: let undecided requirements and comparisons pass.

    Raises:
        InvalidInput: there is nothing to judge, or the baseline has other frames.
        UnknownName: no such function.
        Conflict: numeric classes differ and ``mixed`` is False.
    """
    if baseline is None:
        if not run.verdicts:
            raise InvalidInput(
                "the run has no requirements, and there is no baseline to compare with", field="--baseline",
                limit="requirements in the spec, or --baseline RUN|FUNCTION",
            )  # fmt: skip
        return GateResult(run.id, run.verdicts, (), allow_undecided)
    other = run if isinstance(baseline, str) else baseline
    if other is not run:
        _require_same_frames(run, other)
    versions = tuple(
        _compare(run, version, other, reference, effect, false_discoveries)
        for version, reference in _pairs(run, baseline, function)
        if mixed or _require_one_class(run, version, other, reference)
    )
    return GateResult(run.id, run.verdicts, versions, allow_undecided)


def called(reference: str, run: GateRun) -> str | None:
    """Return the spec's name of a function that is referenced by it, or without its version if unique; otherwise None."""
    functions = run.spec.functions
    if reference in functions:
        return reference
    versions = [function for function in functions if function.partition("@")[0] == reference]
    return versions[0] if len(versions) == 1 else None


def _function(reference: str, run: GateRun, field: str) -> str:
    function = called(reference, run)
    if function is None:
        raise UnknownName("function of the run", reference, run.spec.functions, field=field)
    return function


def _pairs(run: GateRun, baseline: GateRun | str, function: str | None) -> list[tuple[str, str]]:
    """Return (function of the run, function of the baseline)."""
    chosen = run.spec.functions if function is None else (_function(function, run, "--function"),)
    if isinstance(baseline, str):
        reference = _function(baseline, run, "--baseline")
        pairs = [(version, reference) for version in chosen if version != reference]
    elif len(chosen) == len(baseline.spec.functions) == 1:
        pairs = [(chosen[0], baseline.spec.functions[0])]
    else:
        by_name = {own.partition("@")[0]: own for own in baseline.spec.functions}
        pairs = [(version, by_name[name]) for version in chosen if (name := version.partition("@")[0]) in by_name]
    if not pairs:
        raise InvalidInput(
            "there is no other function to compare with the baseline", field="--baseline",
            value=baseline if isinstance(baseline, str) else baseline.id, limit=", ".join(chosen),
        )  # fmt: skip
    return pairs


def _require_same_frames(run: GateRun, baseline: GateRun) -> None:
    if fields := differing_fields(run.spec, baseline.spec, same_asset=run.asset_digest == baseline.asset_digest):
        raise InvalidInput(
            f"run {baseline.id} looked at other frames; what differs: {', '.join(fields)}", field="--baseline",
            value=baseline.id, limit=f"a run that differs only in {', '.join(sorted(FREE))}",
        )  # fmt: skip


def _require_one_class(run: GateRun, version: str, other: GateRun, reference: str) -> bool:
    classes = [
        {
            "image": (parts := numeric_classes(side.pins))["image"],
            "ground truth": parts["ground truth"],
            "inference": parts[inference_part(name)],
        }
        for side, name in ((run, version), (other, reference))
    ]
    for stage, own in classes[0].items():
        if own != classes[1][stage]:
            raise Conflict(
                f"{version} and its baseline {reference} differ in the numeric class of their {stage}: {own} and "
                f"{classes[1][stage]}. Run both in the same one, or use --mixed to include differences of precision "
                "or engine"
            )
    return True


def _compare(
    run: GateRun, version: str, other: GateRun, reference: str, effect: float, false_discoveries: float
) -> VersionGate:
    before, matched, unmatched = _matched(run, version, other, reference)
    compared = compare_versions(
        before,
        matched.numbers("pacc"),
        matched.places,
        {"all": np.ones(len(matched), np.bool_), **levels_of(matched)},
        threshold=run.spec.detection_threshold,
        effect=effect,
        false_discoveries=false_discoveries,
        positions=matched.place_positions,
    )
    named = reference if other is run else f"{reference} of run {other.id}"
    return VersionGate(version, named, compared, unmatched)


def _matched(
    run: GateRun, version: str, other: GateRun, reference: str
) -> tuple[NDArray[np.float64], EvaluationTable, int]:
    """Return the baseline's pACC and the version's rows where both have one, and the number of rows that one alone has."""
    before, after = (
        one.table.select(one.table.codes("function").where(name)) for one, name in ((other, reference), (run, version))
    )
    keys = [
        row_keys(table, table.arrow["sensor"].to_pylist(), frames=frames_of_any_run(table)) for table in (after, before)
    ]
    new, old = paired_rows(*keys)
    return before.numbers("pacc")[old], rows_taken(after, new), len(before) + len(after) - 2 * len(new)


def slice_text(item: SliceComparison, effect: float) -> str:
    """Return one compared slice in words."""
    if not item.pairs:
        return "no pairs"
    text = f"{points(item.difference)} points"
    if item.low is not None and item.high is not None:
        text += f" ({points(item.low)} to {points(item.high)})"
    text += f", {counted(item.pairs, 'pair')} at {counted(item.places, 'place')}, {item.lost:,} lost and {item.gained:,} gained"
    needed = item.places_needed
    if item.worse:
        return text
    if item.alike:
        return f"{text}; {ALIKE_PLACES}"
    if needed is None:
        return f"{text}; the number of places needed to detect a drop of {100 * effect:g} points is unknown"
    too_few = "too few: " if item.too_few else ""
    return f"{text}; {too_few}{needed:,} places show a drop of {100 * effect:g} points"
