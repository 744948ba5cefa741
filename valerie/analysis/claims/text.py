"""A ledger as text."""

from __future__ import annotations

from collections.abc import Sequence

from valerie.analysis.claims.claims import Claims
from valerie.analysis.claims.ledger import LedgerEntry
from valerie.analysis.wording import population, population_of_differences


def ledger_text(claims: Claims, entries: Sequence[LedgerEntry]) -> str:
    """Return the ledger as a Markdown table, and below it what its intervals are for."""

    def cell(text: str) -> str:
        return text.replace("|", "\\|").replace("\n", " ")

    lines = [f"# {claims.title}", "", claims.source, "", "| | Claim | Function | Outcome | What the run shows |"]
    lines.append("|---|---|---|---|---|")
    for entry in entries:
        cells = (entry.source, entry.says, entry.function, str(entry.outcome), entry.finding)
        lines.append(f"| {' | '.join(map(cell, cells))} |")
    lines += ["", *ledger_notes(entries)]
    return "\n".join(lines) + "\n"


def ledger_notes(entries: Sequence[LedgerEntry]) -> list[str]:
    """Return the populations of quantities and of intervals, and the reason why findings have fewer intervals."""
    return [
        f"Quantities are those of {population(estimand)}; intervals of differences and along an axis are for "
        f"{population_of_differences(estimand)}, 95 % each, from all places, since a claim is stated beforehand. A finding is "
        "judged by the places that did not suggest it, together with all others, and may have no interval where a claim has."
        for estimand in dict.fromkeys(entry.estimand for entry in entries)
        if estimand is not None
    ]
