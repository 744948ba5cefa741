"""Findings of a run: differences of pACC that other places confirmed, and unconfirmed candidates."""

from __future__ import annotations

from dataclasses import dataclass

from valerie.errors import InvalidInput
from valerie.statistics.contrasts import Matching
from valerie.statistics.units import Estimand


@dataclass(frozen=True, slots=True)
class Step:
    """A change of a factor from one level to another.

    Attributes:
        factor: name of a parameter, or ``camera``, ``sensor``, ``person``, ``function``.
        before, after: the levels in words.
    """

    factor: str
    before: str
    after: str


@dataclass(frozen=True, slots=True)
class ScoredPerson:
    """A person in one evaluated frame, and its pACC, 0…1."""

    frame_id: str
    sensor: str
    function: str
    instance_id: int
    pacc: float


@dataclass(frozen=True, slots=True)
class Inequality:
    """A measured quantity in which the sides of a step differ strongly, with its mean on both."""

    column: str
    step: Step
    before: float
    after: float


@dataclass(frozen=True, slots=True)
class PictureFault:
    """Pictures that show nothing and carry a finding: without them, less than half of its effect is left.

    Attributes:
        fault: black, white or constant: the most frequent one.
        share: of the views behind the finding that have a faulty picture, 0…1.
        left: the effect without them; None where nothing is left to compare.
    """

    fault: str
    share: float
    left: float | None


@dataclass(frozen=True, slots=True)
class Finding:
    """A difference of mean pACC with its evidence.

    Attributes:
        sentence: the finding in words.
        function: the tested function; empty if functions are compared.
        steps: one for a main effect; two for an interaction: the effect of the first depends on the second.
        matching: rule by which the sides are matched.
        confirmed: True if places that had no part in the search confirm it.
        effect: mean pACC after − before, −1…1, on the confirming places; on the searched places for a candidate that the
            others cannot show.
        low, high: interval of the effect, jointly valid for all confirmed findings; None if it is unknown, as where few places
            show the effect but not its size.
        places, pairs: numbers of places and of pairs of rows behind the effect.
        searched: True if these are only the places that were searched, where the clearest differences look too large.
        places_needed: fresh places that would confirm an effect half as large as the search saw; None: no affordable
            number suffices.
        examples: views before and after the (first) step, all else equal, that differ most in the direction of the effect.
        unequal: measured quantities in which the sides differ strongly, so that they may cause the effect.
        picture_fault: faulty pictures that carry it; None where none do.
        spec: YAML of a run that examines the finding on fresh places; empty if the spec of the run is unknown.
        estimand: what the effect and its interval are over.
        places_for_size: places that would show the size of an effect without interval; None: these do, the effect is not
            shown either, or no affordable number suffices.
        alike: True if neighbouring places are alike in what is compared, so that fresh ones of this site cannot confirm it.
    """

    sentence: str
    function: str
    steps: tuple[Step, ...]
    matching: Matching
    confirmed: bool
    effect: float
    low: float | None
    high: float | None
    places: int
    pairs: int
    places_needed: int | None
    estimand: Estimand
    examples: tuple[tuple[ScoredPerson, ScoredPerson], ...] = ()
    unequal: tuple[Inequality, ...] = ()
    picture_fault: PictureFault | None = None
    spec: str = ""
    places_for_size: int | None = None
    alike: bool = False
    searched: bool = False


@dataclass(frozen=True, slots=True)
class Findings:
    """Findings of a run.

    Attributes:
        items: confirmed findings, those within places first; of several changes of the same factors only the clearest.
        candidates: unconfirmed ones that an affordable number of places could confirm, likewise.
        comparisons: number of contrasts that were tested.
        level: joint confidence.
        places_searched, places_confirming: numbers of places; 0 confirming where there are too few to split.
        notes: sentences about false positives, and about functions that are not compared.
    """

    items: tuple[Finding, ...]
    candidates: tuple[Finding, ...]
    comparisons: int
    level: float
    places_searched: int
    places_confirming: int
    notes: tuple[str, ...] = ()

    def numbered(self, number: int) -> Finding:
        """Return a finding by its number: from 1, candidates after the confirmed ones.

        Raises:
            InvalidInput: none has this number.
        """
        findings = (*self.items, *self.candidates)
        if not findings:
            raise InvalidInput("the run has neither findings nor candidates", field="--finding")
        if not 1 <= number <= len(findings):
            raise InvalidInput("no such finding", field="--finding", value=number, limit=f"1 … {len(findings)}")
        return findings[number - 1]
