"""States, kinds and queues: the vocabulary of rows, messages, REST and texts."""

from __future__ import annotations

from enum import StrEnum
from typing import Final

from valerie.rendering.annotations.kinds import AnnotationKind


class RunState(StrEnum):
    """State of a run."""

    #: Stored; waits for workers that offer what it needs, then its numeric classes are pinned.
    SUBMITTED = "submitted"
    #: Its products are written, computed and counted.
    RUNNING = "running"
    #: Stopped with a reason (a full disk); resumes automatically or on request.
    PAUSED = "paused"
    #: Every product is done or failed; one process writes summary and report.
    FINISHING = "finishing"
    COMPLETED = "completed"
    #: Ended, and some products failed for good.
    COMPLETED_WITH_FAILURES = "completed-with-failures"
    #: Stopped on request; finished products stay.
    CANCELLED = "cancelled"
    #: The run itself cannot continue; its reason says why.
    FAILED = "failed"

    @property
    def is_final(self) -> bool:
        """True if the run continues only when a user resumes or retries it."""
        return self in (self.COMPLETED, self.COMPLETED_WITH_FAILURES, self.CANCELLED, self.FAILED)


class Priority(StrEnum):
    """Priority of a run beside others that need the same workers."""

    LOW = "low"
    NORMAL = "normal"
    HIGH = "high"

    @property
    def weight(self) -> float:
        """Share of the workers beside a run of priority *normal*, which has 1."""
        return {self.LOW: 0.25, self.NORMAL: 1.0, self.HIGH: 4.0}[self]


class ProductState(StrEnum):
    """State of a product."""

    #: An input is not done yet.
    WAITING = "waiting"
    #: Can be claimed.
    READY = "ready"
    #: Leased by a worker.
    RUNNING = "running"
    #: Stored.
    DONE = "done"
    #: Failed for good, with stage, error and attempts.
    FAILED = "failed"
    #: Not wanted by any running run at the moment.
    PARKED = "parked"


class ProductKind(StrEnum):
    """Kind of a product."""

    #: The linear image without movables.
    BACKGROUND = "background"
    #: The part of the linear image that the movables change.
    LAYER = "layer"
    #: Class, instance and depth maps, amodal masks, visibility.
    TRUTH = "truth"
    #: The statics of a truth, which all truths of a camera pose share. Stored with the first of them.
    STATICS = "statics"
    #: Annotations (`valerie.rendering.annotations.kinds`), each under its own name.
    NORMALS = AnnotationKind.NORMALS.value
    BOXES = AnnotationKind.BOXES.value
    JOINTS = AnnotationKind.JOINTS.value
    LIGHT = AnnotationKind.LIGHT.value
    FLOW = AnnotationKind.FLOW.value
    VELOCITY = AnnotationKind.VELOCITY.value
    SCAN = AnnotationKind.SCAN.value
    #: A function's map of train ids.
    PREDICTION = "prediction"
    #: Confusion counts of a prediction against a truth.
    EVALUATION = "evaluation"

    @property
    def has_object(self) -> bool:
        """Return False if its results are rows only."""
        return self not in (ProductKind.EVALUATION, ProductKind.LIGHT)

    @property
    def stage(self) -> Stage:
        """The stage that computes it."""
        if self is ProductKind.PREDICTION:
            return Stage.INFER
        return Stage.EVAL if self is ProductKind.EVALUATION else Stage.RENDER


class Stage(StrEnum):
    """A stage of the pipeline; its queues begin with its name (``render.<numeric class>``)."""

    RENDER = "render"
    INFER = "infer"
    EVAL = "eval"


#: Route of uploaded predictions (functions of kind ``predictions``): no worker serves it, and no message is sent.
UPLOADED_ROUTE: Final = "infer.uploaded"
#: Queue of evaluation and finishing: integer counting gives the same result on every machine, so it has no numeric class.
EVAL_QUEUE: Final = "eval"


def route_of(stage: Stage, *parts: str) -> str:
    """Return the queue of the workers of one stage and numeric class, e.g. ``render.raster.llvmpipe-15``."""
    return ".".join((stage, *parts))


def stage_of(route: str) -> Stage:
    """Return the stage whose workers serve a queue."""
    return Stage(route.partition(".")[0])


def engine_of(route: str) -> str:
    """Return the first part of a queue's numeric class: the render engine, or the truth pass."""
    return route.split(".")[1]
