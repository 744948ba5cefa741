"""Findings of a run: differences of pACC that other places confirmed, and candidates that await that."""

from __future__ import annotations

from dataclasses import dataclass

from valerie.statistics.contrasts import Matching


@dataclass(frozen=True, slots=True)
class Step:
    """A factor that goes from one level to another.

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
    """A measured quantity in which the sides of a step differ strongly: its mean on both."""

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
        sentence: for people.
        function: that was tested; empty where functions are compared.
        steps: one for a main effect; of an interaction two: the effect of the first differs between the sides of the second.
        matching: how the sides are held equal.
        confirmed: whether places that had no part in the search confirm it.
        effect: mean pACC after − before, −1…1: as the confirming places show it; of a candidate that they do not show, as
            the search saw it.
        low, high: interval of the effect, jointly valid for all confirmed findings; None where places cannot tell.
        places, pairs: places and pairs of rows that the effect rests on.
        places_needed: fresh places that would confirm an effect half as large as the search saw; None: no affordable
            number would.
        examples: views before and after the (first) step, all else equal, that differ most in the direction of the effect.
        unequal: measured quantities in which the sides differ strongly, so that the effect may be theirs.
        picture_fault: faulty pictures that carry it; None where none do.
        spec: YAML of a run that examines the finding on fresh places; empty where the spec of the run is unknown.
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
    examples: tuple[tuple[ScoredPerson, ScoredPerson], ...] = ()
    unequal: tuple[Inequality, ...] = ()
    picture_fault: PictureFault | None = None
    spec: str = ""


@dataclass(frozen=True, slots=True)
class Findings:
    """Findings of a run.

    Attributes:
        items: confirmed ones, those within places first; of several changes of the same factors only the clearest.
        candidates: those that were not confirmed, likewise, where an affordable number of places would.
        comparisons: number of contrasts that were looked at.
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
