"""What a server answers to a client."""

from __future__ import annotations

from typing import NamedTuple

from pydantic import BaseModel, ConfigDict, JsonValue

from valerie.runs.moments import Moment


class Answer(BaseModel):
    """Fields of a JSON object from the server."""

    # A newer server may send more fields.
    model_config = ConfigDict(frozen=True, extra="ignore")


class StageProgress(Answer):
    """Progress of one stage.

    Attributes:
        done, total, failed, running: numbers of products.
        rate_per_s: products per second.
        eta_s: remaining seconds; None while unknown.
    """

    done: int
    total: int
    failed: int
    running: int
    rate_per_s: float
    eta_s: float | None = None


class VariantProgress(Answer):
    """Progress through the variants of a run.

    Attributes:
        total: variants of the spec.
        fed: variants whose products have been queued.
        rejected: variants that are impossible or violate a constraint.
    """

    total: int
    fed: int
    rejected: int


class Progress(Answer):
    """Progress of a run."""

    state: str
    reason: str | None = None
    variants: VariantProgress
    stages: dict[str, StageProgress]
    outlook: str | None = None
    updated_at: float | None = None


class Run(Answer):
    """A run in the server's list."""

    id: str
    name: str
    state: str
    reason: str | None = None
    variant_count: int
    rejected_count: int
    tags: tuple[str, ...] = ()
    archived: bool = False
    deadline: Moment | None = None
    created_at: Moment
    started_at: Moment | None = None
    finished_at: Moment | None = None


class Quota(Answer):
    """A quota of an owner or a project.

    Attributes:
        holder: the owner, or ``project NAME``.
        resource: runs, variants, cpu-hours or gigabytes.
        used, forecast: what counts for it now, and what unfinished runs will add.
        limit: of both together.
    """

    holder: str
    resource: str
    used: float
    forecast: float
    limit: float


class Mark(Answer):
    """Tags and note of a run, a frame or a finding.

    Attributes:
        kind: run, frame or finding.
        name: of a frame ``variant.camera.time``, of a finding its sentence; empty for the run.
    """

    kind: str
    name: str
    tags: tuple[str, ...]
    note: str


class Frame(Answer):
    """A frame of a run.

    Attributes:
        id: run.variant.camera.time.
        state: state of its products.
        removed: why its pictures are gone since its run completed; None: they are not.
    """

    id: str
    state: str
    removed: str | None = None


class FailureError(Answer):
    """The reason why a product failed for good.

    Attributes:
        message: the error; None if an input failed.
        attempts: number of attempts; None if an input failed.
        cause: digest of the input that failed; None if the product itself failed.
    """

    message: str | None = None
    attempts: int | None = None
    cause: str | None = None


class Trial(Answer):
    """The trial run of a function at its registration.

    Attributes:
        numeric_class, precision: as read back from the compiled model.
        picture: width and height of the picture, pixels.
        cpu_seconds: CPU time of one picture.
    """

    numeric_class: str
    precision: str
    picture: tuple[int, int]
    cpu_seconds: float


class NoTrial(Answer):
    """The reason why a function had no trial run at its registration."""

    skipped: str


class _Kept(BaseModel):
    # Written to a file again, with all members.
    model_config = ConfigDict(frozen=True, extra="allow")


class FunctionFile(_Kept):
    """The description of a function's file; ``format`` is also its suffix."""

    format: str


class FunctionDocument(_Kept):
    """The document of a registered function.

    Attributes:
        payload: description of its file; None for kinds without a file.
    """

    name: str
    payload: FunctionFile | None = None


class Function(Answer):
    """A function under test with its card.

    Attributes:
        name, digest, architecture, precision, engine, provenance: entries of its card.
        numeric_classes: those in which running workers offer it.
        card: title and text of each row of the card.
        problem: reason why it cannot be used; None if it can.
        reference: name of this version in specs; None for an installed function.
        kind: network, onnx, huggingface, http or predictions; None for a class of an installed package.
        version: number of the registered version.
        classes, unmapped: Cityscapes classes that it predicts, and its own classes that count as void.
        judged_by: Cityscapes classes in its scores over all classes; empty for all.
        created_at: time of registration.
        document: document of a registered version; None in lists.
        check: the trial run, in the answer to a registration.
    """

    name: str
    digest: str
    architecture: str
    precision: str
    engine: str
    provenance: dict[str, str]
    numeric_classes: tuple[str, ...]
    card: tuple[tuple[str, str], ...]
    problem: str | None = None
    reference: str | None = None
    kind: str | None = None
    version: int | None = None
    classes: tuple[str, ...] | None = None
    unmapped: tuple[str, ...] | None = None
    judged_by: tuple[str, ...] = ()
    created_at: str | None = None
    document: FunctionDocument | None = None
    check: Trial | NoTrial | None = None

    def as_json(self) -> dict[str, JsonValue]:
        """Return the members of the registry's answer, as JSON values."""
        return self.model_dump(mode="json", exclude_unset=True)


class RegisteredFunction(NamedTuple):
    """The answer to a registration; ``new`` is False if this version was already registered."""

    function: Function
    new: bool


class RunSummary(Answer):
    """Summary, findings and verdicts of an ended run, as documents for `valerie.analysis`."""

    summary: dict[str, JsonValue]
    findings: dict[str, JsonValue]
    verdicts: tuple[dict[str, JsonValue], ...]


class RunDetail(Answer):
    """The inputs of a run: spec and pins as documents for `valerie.runs`, and the digest of its asset."""

    spec: dict[str, JsonValue]
    asset_digest: str
    pins: dict[str, JsonValue]


class Failure(Answer):
    """A product that failed for good.

    Attributes:
        error: reason of the failure; None if not recorded.
    """

    kind: str
    error: FailureError | None


class StudyOutcomes(Answer):
    """Outcomes of a batch: the score of each variant, None if undefined, and the indexes of rejected variants.

    ``second`` has the scores of the second function, if two are compared.
    """

    scores: tuple[float | None, ...]
    second: tuple[float | None, ...] = ()
    rejected: tuple[int, ...] = ()


class StudyBatch(Answer):
    """A batch of a study.

    Attributes:
        number: number of the batch, from 0.
        reason: reason for these variants.
        legal: number of variants that count towards the budget.
        accepted_at: time of acceptance; None until a person accepts it.
        run_id: its run; None before it starts, and for a batch without variants.
        outcomes: its outcomes; None while its run continues.
        cpu_seconds: CPU time of its run.
    """

    number: int
    reason: str
    legal: int
    accepted_at: Moment | None
    run_id: str | None
    outcomes: StudyOutcomes | None
    cpu_seconds: float | None


class StudyKnown(Answer):
    """The result of a study in words."""

    sentences: tuple[str, ...]


class Study(Answer):
    """A study.

    Attributes:
        state: running, paused, finished or stopped.
        reason: the event that it waits for, or the reason why it ended.
        by_hand: True if a person accepts each batch.
        result: its result; None while nothing is known.
        outlook: what is missing for the goal and its cost, in words; None where that is not known, and in a list of studies.
        batches: its batches; empty in a list of studies.
    """

    id: str
    name: str
    state: str
    reason: str | None = None
    by_hand: bool
    goal: str
    result: StudyKnown | None = None
    outlook: str | None = None
    created_at: Moment
    batches: tuple[StudyBatch, ...] = ()


class NextBatch(Answer):
    """A batch that may run next, with the spec of its run as text and its price."""

    number: int
    reason: str
    legal: int
    rejected: int
    accepted: bool
    run_id: str | None
    spec: str
    plan: dict[str, JsonValue]
