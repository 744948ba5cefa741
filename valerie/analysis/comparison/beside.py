"""Two runs of the same scenes compared: another render engine, another version of a function, another setting.

Frames match if their scenes are equal (`valerie.pipeline.reading.scenes` names the scenes); rows are paired by frame,
sensor setting, function and person, and judged by whole places (`valerie.statistics.gates`). Conclusions are tested in both
runs on the rows that they share, so that neither has more evidence than the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Final

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pydantic import TypeAdapter, ValidationError

from valerie.analysis.claims.claims import Claim, Claims, DifferenceTest
from valerie.analysis.claims.ledger import ClaimOutcome, LedgerEntry, write_ledger
from valerie.analysis.comparison.before_after import GroupDifference, differences_of
from valerie.analysis.findings.findings import Finding
from valerie.analysis.rows.pairing import RowKey, paired_rows, parts_of, row_keys, rows_taken
from valerie.analysis.rows.table import EvaluationTable
from valerie.errors import InvalidInput
from valerie.measures import OF_FUNCTION, names_from
from valerie.plain import JsonObject
from valerie.statistics.fidelity import Fidelity, instance_fidelity

#: Number of pairs with the largest differences that are shown.
_SHOWN_FLIPS: Final = 3
#: Most findings and candidates that are tested in the other run.
_MOST_FINDINGS: Final = 12
#: Where something holds, and where it is not decided, by whether it is so here and there.
_HOLDS: Final = {
    (True, True): "holds in both", (False, False): "holds in neither",
    (True, False): "holds only here", (False, True): "holds only there",
}  # fmt: skip
_UNDECIDED: Final = {
    (True, True): "not decided on either side", (True, False): "not decided here", (False, True): "not decided there",
}  # fmt: skip
#: Columns that are taken from the other run. The function keeps its name in the first run.
_OWN_COLUMNS: Final = tuple(name for name in (*names_from(*OF_FUNCTION), "undefined_reason") if name != "function")


@dataclass(frozen=True, slots=True, eq=False)
class ComparedRun:
    """One of two runs.

    Attributes:
        name: title, such as its renderer.
        run_id: its id.
        table: its evaluations.
        scenes: (N,) name of the scene of each row; frames with equal scenes have equal names.
    """

    name: str
    run_id: str
    table: EvaluationTable
    scenes: NDArray[np.object_]


@dataclass(frozen=True, slots=True)
class SharedSlice:
    """Persons that both runs scored.

    Attributes:
        name: of the slice.
        pairs: number of persons; a person counts once in each frame.
        here, there: mean pACC.
        difference: there − here, by place.
    """

    name: str
    pairs: int
    here: float
    there: float
    difference: GroupDifference


@dataclass(frozen=True, slots=True)
class SharedPerson:
    """A person in the same frame of both runs."""

    frame_here: str
    frame_there: str
    sensor: str
    sensor_there: str
    function: str
    function_there: str
    instance_id: int
    here: float
    there: float


@dataclass(frozen=True, slots=True)
class FunctionBeside:
    """One function in both runs, or one of each.

    Attributes:
        function, sensor: as the first run names them.
        function_there: as the second run names it.
        slices: all persons first, then the parts.
        rank_correlation: Spearman's, over the persons; None with fewer than three or with constant scores.
        fidelity: agreement of the runs about which persons are missed.
        fell, rose: pairs with the largest differences, where the second run scores lower, and where it scores higher.
    """

    function: str
    function_there: str
    sensor: str
    slices: tuple[SharedSlice, ...]
    rank_correlation: float | None
    fidelity: Fidelity
    fell: tuple[SharedPerson, ...]
    rose: tuple[SharedPerson, ...]

    @property
    def title(self) -> str:
        """Name of the function, or of both."""
        return (
            self.function
            if self.function_there == self.function
            else f"{self.function} here, {self.function_there} there"
        )


@dataclass(frozen=True, slots=True)
class Conclusion:
    """A finding or claim, tested in both runs on the frames that they share.

    Attributes:
        kind: ``finding``, ``candidate`` or ``claim``.
        text: its statement, about ``here.function``.
        here, there: the ledger's answers.
    """

    kind: str
    text: str
    here: LedgerEntry
    there: LedgerEntry

    @property
    def decided(self) -> bool:
        """True if both runs answer."""
        return self.here.outcome.decided and self.there.outcome.decided

    @property
    def agreement(self) -> str:
        """Agreement of both runs in words."""
        here, there = self.here.outcome, self.there.outcome
        if self.decided:
            return _HOLDS[here is ClaimOutcome.REPRODUCED, there is ClaimOutcome.REPRODUCED]
        return _UNDECIDED[not here.decided, not there.decided]


@dataclass(frozen=True, slots=True)
class Beside:
    """Comparison of two runs.

    Attributes:
        here, there: names of the runs.
        run_here, run_there: their ids.
        frames: number of frames that both show.
        frames_here, frames_there: number of all frames of each run.
        differs: differences between the specs besides names, in words.
        functions: one entry per function and sensor setting that both have.
        conclusions: findings, candidates and claims.
        where: expression that selected the first run's rows; empty: all.
    """

    here: str
    there: str
    run_here: str
    run_there: str
    frames: int
    frames_here: int
    frames_there: int
    differs: tuple[str, ...]
    functions: tuple[FunctionBeside, ...]
    conclusions: tuple[Conclusion, ...]
    where: str = ""

    def to_json(self) -> JsonObject:
        """Return JSON values."""
        agreements = [conclusion.agreement for conclusion in self.conclusions]
        document = asdict(self)
        for conclusion, agreement in zip(document["conclusions"], agreements, strict=True):
            conclusion["agreement"] = agreement
        return document

    @classmethod
    def from_json(cls, text: str | bytes) -> Beside:
        """Read the document of `to_json`.

        Raises:
            InvalidInput: not such a document; the limit names the first place that does not fit.
        """
        try:
            return TypeAdapter(cls).validate_json(text)
        except ValidationError as error:
            problem = error.errors(include_url=False)[0]
            place = ".".join(map(str, problem["loc"])) or "the document"
            raise InvalidInput(
                "not a comparison of two runs",
                field="beside",
                limit=f"a file of `valerie compare RUN OTHER -o FILE.json`; {place}: {problem['msg']}",
            ) from None

    def slices_table(self) -> pa.Table:
        """Return the paired differences as a table, one row per function, sensor setting and slice."""
        return pa.Table.from_pylist(
            [
                {
                    "function": comparison.function, "function_there": comparison.function_there,
                    "sensor": comparison.sensor, "slice": part.name, "pairs": part.pairs,
                    "places": part.difference.places, "places_needed": part.difference.places_needed,
                    "pacc_here": part.here, "pacc_there": part.there,
                    "difference": part.difference.mean, "low": part.difference.low, "high": part.difference.high,
                    "estimand": part.difference.estimand.value,
                    "lost": part.difference.lost, "gained": part.difference.gained,
                    "judgement": part.difference.judgement, "alike": part.difference.alike,
                    "rank_correlation": comparison.rank_correlation,
                    "same_outcome": comparison.fidelity.share, "kappa": comparison.fidelity.kappa,
                }
                for comparison in self.functions
                for part in comparison.slices
            ]
        )  # fmt: skip


def put_beside(
    here: ComparedRun,
    there: ComparedRun,
    *,
    findings: Sequence[Finding] = (),
    claims: Claims | None = None,
    differs: Sequence[str] = (),
    threshold: float = 0.5,
    seed: int = 0,
) -> Beside:
    """Compare two runs on the scenes that they share.

    Args:
        here, there: the runs.
        findings: findings of the first run, to be tested in both.
        claims: claims to be tested in both.
        differs: differences between the specs, in words.
        threshold: smallest pACC of a detected person; the others are missed.
        seed: of the curves of claims.

    Raises:
        InvalidInput: they share no scene, function and person with a score.
    """
    rows_here, rows_there = paired_rows(_keys(here, there), _keys(there, here))
    if not len(rows_here):
        raise InvalidInput(
            "the runs share no scene that both scored with the same function",
            field="beside",
            value=there.run_id,
            limit="a run of the same variants",
        )
    one = rows_taken(here.table, rows_here)
    other = rows_taken(there.table, rows_there)
    # The rows of the first run with the other run's scores, so that both have the same factors and places.
    scored = one.arrow
    for name in _OWN_COLUMNS:
        scored = scored.set_column(scored.column_names.index(name), name, other.arrow[name])
    two = EvaluationTable(scored, one.parameters, one.designs)
    conclusions = [*_of_findings(findings, one, two, seed), *_of_claims(claims, one, two, seed)]
    return Beside(
        here=here.name,
        there=there.name,
        run_here=here.run_id,
        run_there=there.run_id,
        frames=len(one.codes("frame_id").names),
        frames_here=len(here.table.codes("frame_id").names),
        frames_there=len(there.table.codes("frame_id").names),
        differs=tuple(differs),
        functions=tuple(_functions(one, two, other, threshold)),
        conclusions=tuple(conclusions),
    )


def _keys(side: ComparedRun, other: ComparedRun) -> list[RowKey]:
    """Return the key of each row, without sensor setting or function where each run has only one: names may differ."""
    table = side.table
    names: list[list[str]] = []
    for column in ("function", "sensor"):
        alone = all(len(each.table.codes(column).names) == 1 for each in (side, other))
        texts = table.arrow[column].to_pylist()
        # Versions of one function are the same function.
        names.append([""] * len(texts) if alone else [text.partition("@")[0] for text in texts])
    return row_keys(table, *names, frames=side.scenes.tolist())


def _functions(
    one: EvaluationTable, two: EvaluationTable, other: EvaluationTable, threshold: float
) -> list[FunctionBeside]:
    before, after = one.numbers("pacc"), two.numbers("pacc")
    both = np.isfinite(before) & np.isfinite(after)
    entries = []
    for function in one.codes("function").names:
        for sensor in one.codes("sensor").names:
            own = both & one.codes("function").where(function) & one.codes("sensor").where(sensor)
            if not own.any():
                continue
            masks = {"all persons": own, **{name: own & part for name, part in parts_of(one, own).items()}}
            differences = differences_of(masks, one, two, threshold)
            slices = [
                SharedSlice(
                    name, int(mask.sum()), float(before[mask].mean()), float(after[mask].mean()), differences[name]
                )
                for name, mask in masks.items()
            ]
            rows = np.flatnonzero(own)
            order = rows[np.argsort((after - before)[rows], kind="stable")]
            fell = [row for row in order[:_SHOWN_FLIPS] if after[row] < before[row]]
            rose = [row for row in order[::-1][:_SHOWN_FLIPS] if after[row] > before[row]]
            entries.append(
                FunctionBeside(
                    function,
                    str(other.arrow["function"][int(rows[0])]),
                    sensor,
                    tuple(slices),
                    _rank_correlation(before[own], after[own]),
                    instance_fidelity(before[own] < threshold, after[own] < threshold, one.units.of(own)),
                    tuple(_pair(one, other, int(row)) for row in fell),
                    tuple(_pair(one, other, int(row)) for row in rose),
                )
            )
    return entries


def _rank_correlation(one: NDArray[np.float64], other: NDArray[np.float64]) -> float | None:
    """Return Spearman's rank correlation: Spearman 1904, *American Journal of Psychology* 15, 72–101."""
    from scipy.stats import spearmanr

    if len(one) < 3 or np.ptp(one) == 0 or np.ptp(other) == 0:
        return None
    return float(spearmanr(one, other).statistic)


def _pair(one: EvaluationTable, other: EvaluationTable, row: int) -> SharedPerson:
    here, there = one.arrow.slice(row, 1).to_pylist()[0], other.arrow.slice(row, 1).to_pylist()[0]
    return SharedPerson(
        here["frame_id"],
        there["frame_id"],
        here["sensor"],
        there["sensor"],
        here["function"],
        there["function"],
        here["instance_id"],
        here["pacc"],
        there["pacc"],
    )


def _of_findings(
    findings: Sequence[Finding], one: EvaluationTable, two: EvaluationTable, seed: int
) -> list[Conclusion]:
    """Test main effects; the ledger has no test for interactions or comparisons of functions."""
    conclusions = []
    for finding in findings[:_MOST_FINDINGS]:
        if len(finding.steps) != 1 or not finding.function:
            continue
        step = finding.steps[0]
        sign = ">" if finding.effect > 0 else "<"
        text = (
            f"pACC is {'higher' if sign == '>' else 'lower'} with {step.factor} {step.after} than with {step.before}."
        )
        test = DifferenceTest(factor=step.factor, first=step.after, second=step.before, sign=sign)
        claim = Claim(id="finding", says=text, functions=(finding.function,), difference=test)
        kind = "finding" if finding.confirmed else "candidate"
        conclusions += _tested(kind, Claims(title=text, claims=(claim,)), one, two, seed)
    return conclusions


def _of_claims(claims: Claims | None, one: EvaluationTable, two: EvaluationTable, seed: int) -> list[Conclusion]:
    if claims is None:
        return []
    conclusions = []
    for claim in claims.claims:
        # A claim about frames, without a function, has the same answer in both runs.
        if not (claim.slip or claim.untestable):
            conclusions += _tested("claim", claims.model_copy(update={"claims": (claim,)}), one, two, seed)
    return [conclusion for conclusion in conclusions if conclusion.here.function]


def _tested(kind: str, claims: Claims, one: EvaluationTable, two: EvaluationTable, seed: int) -> list[Conclusion]:
    """Return the answers of both runs; empty if the shared rows lack a factor, level or function of the claim."""
    try:
        pairs = zip(write_ledger(claims, one, seed=seed), write_ledger(claims, two, seed=seed), strict=True)
    except InvalidInput:
        return []
    return [
        Conclusion(kind, here.says, here, there)
        for here, there in pairs
        if here.outcome is not ClaimOutcome.NOT_TESTABLE
    ]
