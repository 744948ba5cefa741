"""Sentences about comparisons."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from valerie.analysis.comparison.before_after import GroupDifference, VersionChange, VersionComparison
from valerie.analysis.wording import ALIKE_PLACES, NO_INTERVAL, counted, for_whom, minus, percent, points, population
from valerie.measures import measure_of
from valerie.runs.document.varied import DISTRIBUTIONS
from valerie.statistics.fidelity import Fidelity
from valerie.statistics.gates import EFFECT

#: Most undecided slices that a sentence names.
_NAMED: Final = 5


def change_sentence(change: VersionChange) -> str:
    """Return one change between two versions with its numbers."""
    values = f"{percent(change.before)} → {percent(change.after)} %"
    if change.kind == "class":
        return f"class {change.name}: pooled IoU {values}"
    if change.kind == "score":
        return f"person {measure_of(change.name).title}, pooled: {values}"
    own = change.difference
    assert own is not None
    return f"{change.name}: mean pACC {values} ({difference_text(own)}; {own.lost:,} lost, {own.gained:,} gained)"


def difference_text(difference: GroupDifference) -> str:
    """Return a difference of mean pACC as text: ``−0.4 points by place, 95 % [−0.9, +0.1] for …, 24 places``."""
    return f"{points(difference.mean)} points by place{span_text(difference)}, {difference.places:,} places"


def span_text(difference: GroupDifference) -> str:
    """Return the interval of a difference and what it is for, ``, 95 % [−0.2, +1.4] for …``; or why there is none."""
    if difference.alike:
        return f" {NO_INTERVAL}"
    if difference.low is None or difference.high is None:
        return ""
    ends = f"[{points(difference.low)}, {points(difference.high)}]"
    return f", 95 % {ends}{for_whom(difference.estimand)}"


def undecided_text(undecided: Mapping[str, tuple[int, int | None, bool]], slices: int, change: str) -> str:
    """Return which slices are undecided, and how many places the first one needs, or that its places are alike.

    Args:
        undecided: name to places, needed places, and whether they are alike, of each; at least one.
        slices: number of all slices.
        change: the change to show, such as ``a drop of 5 points``.
    """
    names = list(undecided)
    rest = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    places, needed, alike = undecided[names[0]]
    need = "needs an unknown number" if needed is None else f"needs about {needed:,}"
    why = f"has {counted(places, 'place')} and {need} to show {change}"
    if alike:
        why = f"is of one site, where {ALIKE_PLACES}"
    return (
        f"{len(names):,} of {counted(slices, 'slice')} {'is' if len(names) == 1 else 'are'} undecided: "
        f"{', '.join(names[:_NAMED])}{rest}; '{names[0]}' {why}"
    )


def undecided_groups(differences: Mapping[str, GroupDifference]) -> str:
    """Return the undecided groups of a comparison as a sentence; empty if all are decided."""
    undecided = {name: (own.places, own.places_needed, own.alike) for name, own in differences.items() if own.undecided}
    change = f"a change of {100 * EFFECT:g} points"
    return f"{undecided_text(undecided, len(differences), change)}." if undecided else ""


def numeric_classes_sentence(comparison: VersionComparison) -> str:
    """Return the numeric classes that the versions ran in, with a warning where they differ; empty if unknown."""
    if not comparison.numeric_classes:
        return ""
    if comparison.alike:
        return f"All ran as {comparison.numeric_classes[0]}."
    ran = zip(comparison.versions, comparison.numeric_classes, strict=True)
    return (
        f"Numeric classes differ, so differences may come from precision or engine: "
        f"{'; '.join(f'{version} ran as {numeric_class}' for version, numeric_class in ran)}."
    )


def difference_of_specs(place: str, here: object, there: object, *, own: str = "here", other: str = "there") -> str:
    """Return a value that two specs set differently, with its place; ``own`` and ``other`` name the sides."""
    return f"{place} ({_setting(here)} {own}, {_setting(there)} {other})"


def _setting(value: object) -> str:
    """Return a value as specs write it; a distribution as in the list notation."""
    if isinstance(value, Mapping):
        if (of := DISTRIBUTIONS.get(str(value.get("distribution")))) is not None:
            numbers = ", ".join(_setting(value[field]) for field in of.listed if value.get(field) is not None)
            more = {key: part for key, part in value.items() if key not in ("distribution", *of.listed)}
            return " ".join(filter(None, (of.word(), numbers, _setting(more))))
        return ", ".join(f"{key} {_setting(part)}" for key, part in value.items() if part is not None)
    if isinstance(value, list | tuple):
        return ", ".join(map(_setting, value))
    if isinstance(value, bool):
        return str(value).lower()
    return "not set" if value is None else str(value)


def fidelity_sentence(fidelity: Fidelity, here: str = "here", there: str = "there") -> str:
    """Return on how many persons two sides agree, and of the missed ones here how many are missed there.

    Args:
        fidelity: the counts.
        here, there: names of the sides in the sentence.
    """
    span = ""
    if fidelity.low is not None and fidelity.high is not None:
        span = f", 95 % [{percent(fidelity.low)}, {percent(fidelity.high)}]"
        span += f" for {population(fidelity.estimand)}"
    kappa = "" if fidelity.kappa is None else f", κ {minus(f'{fidelity.kappa:.2f}')}"
    return (
        f"{percent(fidelity.share)} % of {fidelity.persons:,} persons are missed on both sides or on neither{span}{kappa}. "
        f"Of {fidelity.missed_here:,} missed {here}, {fidelity.both:,} are missed {there}, too; "
        f"{fidelity.only_there:,} only {there}."
    )
