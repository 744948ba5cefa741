"""Progress of a run, as counted by the control loop."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from typing import NamedTuple

from valerie.document import Document
from valerie.runs.moments import duration
from valerie.runs.products.states import RunState, Stage


class StageCounts(NamedTuple):
    """Work of one stage.

    Attributes:
        total: frames (render) or evaluations (infer, eval).
        done, failed: number of them that are done, and that failed for good.
    """

    total: int
    done: int
    failed: int

    @property
    def unfinished(self) -> int:
        """Number that are neither done nor failed."""
        return self.total - self.done - self.failed


class BlockCounts(Document):
    """Frames and evaluations of a range of variants.

    A failure counts at the stage where it happened and at every later one.

    Attributes:
        frames, evaluations: numbers of all.
        rendered, render_failed: frames whose background, layer, truth and annotations are done; frames with a failure.
        inferred, infer_failed: evaluations whose prediction is done, or failed.
        evaluated, eval_failed: evaluations whose scores are done, or failed.
    """

    frames: int
    rendered: int
    render_failed: int
    evaluations: int
    inferred: int
    infer_failed: int
    evaluated: int
    eval_failed: int

    def stage(self, stage: Stage) -> StageCounts:
        """Return the counts of one stage."""
        if stage is Stage.RENDER:
            return StageCounts(self.frames, self.rendered, self.render_failed)
        if stage is Stage.INFER:
            return StageCounts(self.evaluations, self.inferred, self.infer_failed)
        return StageCounts(self.evaluations, self.evaluated, self.eval_failed)

    @property
    def unfinished(self) -> int:
        """Number of products that have not ended: three per frame, prediction and scores per evaluation."""
        frames, predictions, scores = (self.stage(stage).unfinished for stage in Stage)
        return 3 * frames + predictions + scores

    @property
    def is_final(self) -> bool:
        """True if nothing is left to do."""
        return all(counts.done + counts.failed == counts.total for counts in map(self.stage, Stage))

    @classmethod
    def total(cls, parts: Iterable[BlockCounts]) -> BlockCounts:
        """Add the counts of several blocks."""
        sums = Counter(dict.fromkeys(cls.model_fields, 0))
        for part in parts:
            sums.update(dict(part))
        return cls.model_validate(sums)


class StageProgress(Document):
    """Progress of one stage.

    Attributes:
        done, failed: frames (render) or evaluations (infer, eval).
        total: exact once every variant is fed; extrapolated before.
        running: products of this stage that workers hold, for all runs.
        rate_per_s: number that end per second.
        eta_s: seconds until the rest ends; None until ten have ended, and while nothing ends. A stage that waits for more to be
            fed has that of the slowest other stage.
    """

    done: int
    total: int
    failed: int
    running: int
    rate_per_s: float
    eta_s: float | None

    @property
    def unfinished(self) -> int:
        """Number that are neither done nor failed."""
        return self.total - self.done - self.failed


class VariantProgress(Document):
    """Numbers of all variants of the run, of those with rows, and of rejected ones."""

    total: int
    fed: int
    rejected: int


class FrameProgress(Document):
    """Number of frames that have rows; ``exact`` is True once all have."""

    fed: int
    exact: bool


class Progress(Document):
    """Progress of a run.

    Attributes:
        state: state of the run.
        reason: reason why it waits, is paused or failed.
        variants, frames: the part of the run that has rows.
        stages: render counts frames; infer and eval count evaluations. Empty before the first count.
        awaiting: number of predictions that are yet to be uploaded.
        updated_at: Unix seconds of the count; None before the first.
    """

    state: RunState
    reason: str | None
    variants: VariantProgress
    frames: FrameProgress
    stages: dict[Stage, StageProgress]
    awaiting: int
    updated_at: float | None

    @property
    def left(self) -> float:
        """Share of the work that has not ended, from 0 to 1."""
        total = sum(stage.total for stage in self.stages.values())
        ended = sum(stage.done + stage.failed for stage in self.stages.values())
        return max(0.0, 1 - ended / total) if total else 1.0


class ProgressToday(Progress):
    """Progress of a run at the moment of reading.

    Attributes:
        outlook: True if it will be done by its deadline at its present rate; None if it has none or has ended.
    """

    outlook: str | None


def outlook(counted: Progress | None, state: RunState, left: float, now: float) -> str | None:
    """Compare in words the deadline of an unfinished run with its end at the present rate.

    Args:
        counted: at the latest count.
        state: of the run.
        left: seconds until the deadline.
        now: Unix seconds.
    """
    if state.is_final:
        return None
    words = f"deadline in {duration(left)}" if left >= 0 else f"deadline passed {duration(-left)} ago"
    times = [] if counted is None else [stage.eta_s for stage in counted.stages.values()]
    known = [seconds for seconds in times if seconds is not None]
    if state is not RunState.RUNNING or counted is None or not times or len(known) < len(times):
        return words
    needed = max(0.0, max(known) - (now - (counted.updated_at or now)))
    if needed > left:
        return f"{words}, will be missed by about {duration(needed - left)}"
    return f"{words}, done in about {duration(needed)}"
