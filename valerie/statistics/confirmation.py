"""Confirmed findings: one half of the places is searched for candidates, which the other half tests.

The places that confirm have no part in the search, however it chooses. So only the candidates count as comparisons: Holm's
procedure (Holm 1979, Scandinavian Journal of Statistics 6, 65–70) over them bounds the chance of even one false confirmed
finding by 1 − level (splitting: Cox 1975, doi:10.1093/biomet/62.2.441).
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from valerie.errors import InvalidInput
from valerie.statistics.contrasts import Change, Contrast, contrasts
from valerie.statistics.observations import Observations
from valerie.statistics.power import places_needed

#: Largest expected share of false candidates (Benjamini–Hochberg): each costs the others power.
FALSE_CANDIDATES: Final = 0.2
#: Fewest and most candidates that a search hands on.
FEWEST: Final = 2
MOST: Final = 12
#: Fewest places in each half; with fewer, all places are searched and a fresh run has to confirm.
FEWEST_PLACES: Final = 5


@dataclass(frozen=True, slots=True)
class Search:
    """Candidates from one set of places.

    Attributes:
        candidates: the contrasts with the smallest weighted p-values, ascending.
        comparisons: how many contrasts were looked at.
        places: places that were searched.
    """

    candidates: tuple[Contrast, ...]
    comparisons: int
    places: int


@dataclass(frozen=True, slots=True)
class Confirmation:
    """A candidate with its test on other places.

    Attributes:
        candidate: the contrast as the search saw it; its estimate is exaggerated, because it was chosen for its size.
        contrast: the same contrast on places that the search did not see; None if it cannot be computed there.
        confirmed: True if they confirm it, in the same direction.
        adjusted_p: p-value with all candidates accounted for (Holm).
        low, high: interval of the difference on the places that confirm. On average at most 1 − level of the intervals of
            confirmed findings miss the truth (Benjamini & Yekutieli 2005, doi:10.1198/016214504000001907), and none of
            them contains 0: where few places confirm a difference but not its size, the interval is infinite, as it is where
            they give no estimate of the error.
        places_for_size: number of places like those that confirm (or name) a finding that would give it an interval; None if it
            has one, or if no affordable number suffices.
        places_needed: number of fresh places with which 90 % of runs confirm an effect half as large as the search saw,
            with all candidates accounted for; None if no affordable number suffices.
        alike: True if neighbouring places are alike in what is compared, so that they are no independent evidence.
    """

    candidate: Contrast
    contrast: Contrast | None
    confirmed: bool
    adjusted_p: float
    low: float
    high: float
    places_needed: int | None
    places_for_size: int | None = None
    alike: bool = False


@dataclass(frozen=True, slots=True)
class Confirmations:
    """Candidates of a run, confirmed or not.

    Attributes:
        items: confirmed ones first, then in the order of the search.
        comparisons: contrasts that were searched.
        level: joint confidence of all confirmed findings.
        places_searched, places_confirming: numbers of places; 0 confirming where the run had too few to split.
    """

    items: tuple[Confirmation, ...]
    comparisons: int
    level: float
    places_searched: int
    places_confirming: int


def halves(places: int, seed: int) -> NDArray[np.bool_]:
    """Choose half of the places for the search.

    Of each pair of consecutive places one is searched and one confirms, so both halves cover the whole design.

    Args:
        places: number of places.
        seed: of the choice.

    Returns:
        (places,) bool, True for places to search; if the number is odd, the last place confirms.
    """
    couples = places // 2
    first = np.random.default_rng(seed).random(couples) < 0.5
    return np.concatenate([np.stack([first, ~first], axis=1).ravel(), np.zeros(places % 2, np.bool_)])


def search(
    observations: Observations, *, interactions: bool = True, only: Sequence[tuple[Change, ...]] | None = None
) -> Search:
    """Test every contrast and keep those that pass false discovery control, at least `FEWEST` and at most `MOST`.

    All main effects together have the same weight as all interactions, which are far more numerous.

    Args:
        observations: the places to search.
        interactions: True to test differences of differences too.
        only: the changes to test; None: all.
    """
    from scipy.stats import false_discovery_control

    looked_at = contrasts(replace(observations, positions=None), interactions=interactions, only=only)
    if not looked_at:
        return Search((), 0, observations.places)
    order = np.array([len(item.changes) for item in looked_at])
    _, kind, sizes = np.unique(order, return_inverse=True, return_counts=True)
    # Weighted p-values (Genovese, Roeder & Wasserman 2006, doi:10.1093/biomet/93.3.509).
    weights = len(looked_at) / len(sizes) / sizes[kind]
    weighted = np.minimum(np.array([item.p_value for item in looked_at]) / weights, 1.0)
    kept = int(np.count_nonzero(false_discovery_control(weighted) <= FALSE_CANDIDATES))
    clearest = np.argsort(weighted, kind="stable")[: min(max(kept, FEWEST), MOST)]
    return Search(
        tuple(looked_at[k] for k in clearest if looked_at[k].p_value < 1), len(looked_at), observations.places
    )


def confirm(
    candidates: Search,
    observations: Observations,
    *,
    level: float = 0.95,
    alike: Collection[tuple[Change, ...]] = (),
) -> Confirmations:
    """Test candidates on places that the search did not see: the other half, or a fresh run.

    Args:
        candidates: from `search`.
        observations: rows of other places, with the same factors and codes.
        level: joint confidence; the chance of any false confirmed finding is at most 1 − ``level``.
        alike: changes in which neighbouring places are alike (`valerie.statistics.neighbours`); they are neither confirmed nor
            have they an interval.

    Raises:
        InvalidInput: the level lies outside 0…1.
    """
    if not 0 < level < 1:
        raise InvalidInput("has to lie between 0 and 1", field="level", value=level)
    chosen = candidates.candidates
    evident = [item.changes for item in chosen if item.changes not in alike]
    # All places together, not this half, decide which changes are alike.
    independent = replace(observations, positions=None)
    by_changes = {item.changes: item for item in contrasts(independent, only=evident)}
    tested = [by_changes.get(item.changes) for item in chosen]
    adjusted = holm([1.0 if item is None else item.p_value for item in tested])
    agrees = [new is not None and new.estimate * old.estimate > 0 for new, old in zip(tested, chosen, strict=True)]
    confirmed = [agree and p_value <= 1 - level for agree, p_value in zip(agrees, adjusted.tolist(), strict=True)]
    each = 1 - (1 - level) / max(len(chosen), 1)
    sized = sum(
        holds and new is not None and new.excludes_0(each) for new, holds in zip(tested, confirmed, strict=True)
    )
    shown = 1 - (1 - each) * max(sized, 1)
    findings = []
    for candidate, contrast, holds, p_value in zip(chosen, tested, confirmed, adjusted.tolist(), strict=True):
        low, high, for_size = -float("inf"), float("inf"), None
        if contrast is not None and holds:
            low, high, for_size = _size(contrast, each, shown)
        elif contrast is not None:
            low, high = contrast.interval(shown)
        needed = fresh_places(candidate, candidate.estimate / 2, level=each)
        together = candidate.changes in alike
        findings.append(Confirmation(candidate, contrast, holds, p_value, low, high, needed, for_size, together))
    findings.sort(key=lambda finding: not finding.confirmed)
    return Confirmations(tuple(findings), candidates.comparisons, level, candidates.places, observations.places)


def find(
    observations: Observations,
    *,
    seed: int,
    interactions: bool = True,
    only: Sequence[tuple[Change, ...]] | None = None,
    level: float = 0.95,
) -> Confirmations:
    """Search half of the places and confirm in the other half; with too few places, search only.

    A candidate in which neighbouring places are alike is not confirmed.

    Args:
        observations: all rows of a run.
        seed: of the halves.
        interactions, only: as of `search`.
        level: as of `confirm`.
    """
    searching = halves(observations.places, seed)
    if np.count_nonzero(searching) < FEWEST_PLACES:
        nowhere = observations.of_places(np.zeros(observations.places, np.bool_))
        return confirm(search(observations, interactions=interactions, only=only), nowhere, level=level)
    candidates = search(observations.of_places(searching), interactions=interactions, only=only)
    chosen = [item.changes for item in candidates.candidates]
    alike = {item.changes for item in contrasts(observations, only=chosen) if item.alike}
    return confirm(candidates, observations.of_places(~searching), level=level, alike=alike)


def named(
    observations: Observations,
    *,
    only: Sequence[tuple[Change, ...]] | None = None,
    level: float = 0.95,
) -> tuple[Confirmation, ...]:
    """Return the main effects that are significant over all places, by Holm's procedure; none counts as confirmed.

    With few places this detects what half of them cannot. The p-values are valid, but anything that the places share (a site,
    a house) is part of each effect. Effects in which neighbouring places are alike are left out.

    Args:
        observations: all rows of a run.
        only: as of `search`.
        level: joint confidence.

    Returns:
        The clearest first. Their intervals hold together (Bonferroni); those that contain 0 are infinite.
    """
    looked_at = [item for item in contrasts(observations, interactions=False, only=only) if not item.alike]
    adjusted = holm([item.p_value for item in looked_at])
    each = 1 - (1 - level) / max(len(looked_at), 1)
    chosen = [k for k in np.argsort(adjusted, kind="stable").tolist() if adjusted[k] <= 1 - level]
    findings = []
    for k in chosen:
        item = looked_at[k]
        needed = fresh_places(item, item.estimate / 2, level=each)
        low, high, for_size = _size(item, each, each)
        findings.append(Confirmation(item, item, False, float(adjusted[k]), low, high, needed, for_size))
    return tuple(findings)


def _size(contrast: Contrast, level: float, shown: float) -> tuple[float, float, int | None]:
    """Return the interval of an effect at the level ``shown``, and None.

    If it contains 0 at ``level``, it is infinite, and the number is of places like these whose interval would not.
    """
    if contrast.excludes_0(level):
        return *contrast.interval(shown), None
    return -float("inf"), float("inf"), contrast.places_for_interval(level)


def fresh_places(contrast: Contrast, effect: float, *, level: float = 0.95) -> int | None:
    """Return the number of places that a run needs to detect an effect in such a contrast with a chance of 90 %.

    It is None above ten million.

    Args:
        contrast: supplies the standard deviation between places.
        effect: smallest difference to detect, in units of the values.
        level: confidence of the two-sided test.

    Raises:
        InvalidInput: the effect is 0.
    """
    if contrast.degrees <= 0:
        return None
    return places_needed(effect, contrast.deviation, alpha=(1 - level) / 2, parameters=contrast.parameters)


def holm(p_values: Sequence[float] | ArrayLike) -> NDArray[np.float64]:
    """Return the p-values adjusted by Holm's step-down procedure: all at or below α may be rejected together."""
    p = np.asarray(p_values, np.float64)
    order = np.argsort(p, kind="stable")
    adjusted = np.empty_like(p)
    adjusted[order] = np.minimum(np.maximum.accumulate(p[order] * np.arange(len(p), 0, -1)), 1.0)
    return adjusted
