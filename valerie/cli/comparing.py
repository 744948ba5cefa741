"""Two runs beside each other, for a rich console."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from rich.console import RenderableType

    from valerie.analysis.comparison.beside import Beside

_NOTE: Final = (
    "pACC is the mean over persons, the difference the mean over places. Lower and higher come from three paired tests together, "
    "with at most 5 % false ones among all lines; the interval is that of the mean alone, and may contain 0."
)


def renderables(beside: Beside) -> list[RenderableType]:
    """Return the differences by function, the views with the largest drops, and the conclusions."""
    from rich.table import Table
    from rich.text import Text

    from valerie.analysis.comparison.wording import fidelity_sentence, span_text, undecided_groups
    from valerie.analysis.wording import percent, points

    parts: list[RenderableType] = [
        Text(
            f"{beside.here} (here) and {beside.there} (there){f', where {beside.where}' if beside.where else ''}: "
            f"{beside.frames:,} frames show the same scenes",
            "bold",
        )
    ]
    parts += [Text(f"  {difference}", "dim") for difference in beside.differs]
    for comparison in beside.functions:
        rank = "" if comparison.rank_correlation is None else f", rank correlation {comparison.rank_correlation:.3f}"
        table = Table(
            box=None, pad_edge=False, header_style="dim", title=f"{comparison.title}{rank}", title_justify="left"
        )
        table.add_column("persons")
        for name in ("pairs", "pACC here, %", "there, %", "difference, points"):
            table.add_column(name, justify="right", no_wrap=True)
        table.add_column("")
        for part in comparison.slices:
            own = part.difference
            table.add_row(
                part.name,
                f"{part.pairs:,}",
                percent(part.here),
                percent(part.there),
                f"{points(own.mean)}{span_text(own)}",
                {"worse": "lower there", "better": "higher there", "": ""}[own.judgement],
            )
        parts.append(table)
        if undecided := undecided_groups({part.name: part.difference for part in comparison.slices}):
            parts.append(Text(f"  {undecided}", "dim"))
        parts.append(Text(f"  {fidelity_sentence(comparison.fidelity)}", "dim"))
        parts += [
            Text(
                f"  fell from {percent(pair.here)} to {percent(pair.there)} %: {pair.frame_here} → {pair.frame_there}",
                "dim",
            )
            for pair in comparison.fell
        ]
    if beside.functions:
        parts.append(Text(_NOTE, "dim"))
    if beside.conclusions:
        parts.append(Text("Conclusions, on the shared frames", "bold"))
    for conclusion in beside.conclusions:
        verb = "" if conclusion.decided else "is "
        parts.append(Text(f"  {conclusion.here.function}: {conclusion.text} This {verb}{conclusion.agreement}."))
        parts.append(Text(f"    here: {conclusion.here.finding}; there: {conclusion.there.finding}", "dim"))
    return parts


def contents(beside: Beside, suffix: str) -> bytes:
    """Return the comparison as a file: ``.json``, or its differences by slice as ``.csv`` or ``.parquet``."""
    from valerie.analysis.rows.table import encoded

    if suffix == ".json":
        return json.dumps(beside.to_json(), ensure_ascii=False).encode()
    return encoded(beside.slices_table(), suffix[1:])
