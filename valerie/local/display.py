"""The progress of a run: a live table on a terminal, occasional lines elsewhere, JSON lines for machines."""

from __future__ import annotations

import json
import sys
import time
from typing import Any, Final, Protocol, Self

from rich.bar import Bar
from rich.console import Group, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text

from valerie.answers import Progress, StageProgress
from valerie.local.terminal import console
from valerie.runs.moments import duration
from valerie.runs.products.states import RunState

#: Stage to the name of its products.
STAGES: Final = {"render": "frames", "infer": "predictions", "eval": "evaluations"}
_LINE_SECONDS: Final = 5.0
_BAR: Final = 24


class Display(Protocol):
    """Shows progress; a context manager."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """Leave what is shown."""
        return

    def update(self, progress: Progress) -> None:
        """Show the current progress."""
        ...


class LiveDisplay(Display):
    """A table that is redrawn in place."""

    def __init__(self, title: str) -> None:
        self._title = title
        self._live = Live(console=console(stderr=True), refresh_per_second=4, transient=False)

    def __enter__(self) -> Self:
        self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._live.stop()

    def update(self, progress: Progress) -> None:
        """Redraw the table."""
        self._live.update(progress_table(self._title, progress))


class LineDisplay(Display):
    """Prints a line whenever the state changes, and every few seconds if anything else changed."""

    def __init__(self, title: str) -> None:
        self._title = title
        self._shown_at = -_LINE_SECONDS
        self._shown: tuple[object, ...] = ()
        self._state = ""

    def update(self, progress: Progress) -> None:
        """Print a line if one is due."""
        counts = (*((stage.done, stage.failed) for stage in progress.stages.values()), progress.reason)
        now = time.monotonic()
        if progress.state == self._state and (counts == self._shown or now - self._shown_at < _LINE_SECONDS):
            return
        self._shown, self._shown_at, self._state = counts, now, progress.state
        sys.stderr.write(progress_line(self._title, progress) + "\n")
        sys.stderr.flush()


class JsonDisplay(Display):
    """Prints a line with a JSON object to standard output whenever something changed."""

    def __init__(self, run_id: str) -> None:
        self._run_id = run_id
        self._shown: Progress | None = None

    def update(self, progress: Progress) -> None:
        """Print the progress if it has changed."""
        timeless = progress.model_copy(update={"updated_at": None})
        if timeless != self._shown:
            self._shown = timeless
            print_event("progress", run=self._run_id, **timeless.model_dump(mode="json", exclude={"updated_at"}))


def display_of(title: str, run_id: str, *, json_lines: bool) -> Display:
    """Return the display that fits the output."""
    if json_lines:
        return JsonDisplay(run_id)
    return LiveDisplay(title) if sys.stderr.isatty() else LineDisplay(title)


def print_event(event: str, **values: Any) -> None:
    """Print a line of ``--json``."""
    sys.stdout.write(json.dumps({"event": event, **values}, ensure_ascii=False, separators=(",", ":")) + "\n")
    sys.stdout.flush()


def progress_table(title: str, progress: Progress) -> RenderableType:
    """Return a table with one row per stage: a bar, counts, rate, remaining time and failures."""
    head = Text.assemble((title, "bold"), "  ", (progress.state, _style(progress.state)), "  ", _variants(progress))
    table = Table.grid(padding=(0, 1))
    table.add_column(no_wrap=True)
    table.add_column(max_width=_BAR)  # the only column that shrinks with the terminal
    for _ in range(4):
        table.add_column(justify="right", no_wrap=True)
    ended = RunState(progress.state).is_final
    for name, unit in STAGES.items():
        stage = progress.stages.get(name)
        if stage is None:
            continue
        failed = Text(f"{stage.failed:,} failed", style="bold red") if stage.failed else Text("")
        complete = stage.total > 0 and stage.done >= stage.total
        table.add_row(
            f"  {name}",
            Bar(max(stage.total, 1), 0, stage.done, color="green" if complete else "cyan"),
            f"{stage.done:,} / {stage.total:,} {unit}",
            f"{stage.rate_per_s:.1f}/s" if stage.rate_per_s and not complete else "",
            "done" if complete else "" if ended else remaining(stage),
            failed,
        )
    parts: list[RenderableType] = [head, table]
    if progress.outlook:
        parts.append(Text(f"  {progress.outlook}"))
    if progress.reason:
        parts.append(Text(f"  {progress.reason}", style="yellow"))
    return Group(*parts)


def progress_line(title: str, progress: Progress) -> str:
    """Return the progress as one line."""
    parts = [f"{title}: {progress.state}"]
    for name, stage in progress.stages.items():
        text = f"{name} {stage.done:,}/{stage.total:,}"
        if stage.failed:
            text += f" ({stage.failed:,} failed)"
        if stage.rate_per_s and stage.done < stage.total:
            text += f" {stage.rate_per_s:.1f}/s"
        parts.append(text)
    open_stages = [stage for stage in progress.stages.values() if stage.done + stage.failed < stage.total]
    left = [stage.eta_s for stage in open_stages if stage.eta_s is not None]
    # Of the stage that ends last: without its time, those of the others say too little.
    if left and len(left) == len(open_stages) and not RunState(progress.state).is_final:
        parts.append(f"about {duration(max(left))} left")
    if progress.reason:
        parts.append(progress.reason)
    return ", ".join(parts)


def remaining(stage: StageProgress) -> str:
    """Return the remaining time of a stage as text: empty if it is done, ``…`` if unknown."""
    if stage.done + stage.failed >= stage.total:
        return ""
    return f"{duration(stage.eta_s)} left" if stage.eta_s is not None else "…"


def _variants(progress: Progress) -> str:
    variants = progress.variants
    text = f"{variants.total:,} variants"
    return f"{text}, {variants.rejected:,} rejected" if variants.rejected else text


def _style(state: str) -> str:
    if state == RunState.COMPLETED:
        return "bold green"
    if state in (RunState.FAILED, RunState.CANCELLED, RunState.COMPLETED_WITH_FAILURES):
        return "bold red"
    return "yellow" if state == RunState.PAUSED else "cyan"
