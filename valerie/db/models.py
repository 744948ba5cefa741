"""The tables. Documents are JSON columns; everything that queries filter, join or plot has a column of its own.

Products belong to no run. A *frame* links a variant to its background, layer and truth; an *evaluation* links a frame, a
sensor setting and a function to its prediction and scores. A product without a link is not computed, and `gc` frees it.
Product digests (32 hexadecimal characters) are primary keys: rows can be written without a query for existing ones.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from datetime import datetime
from typing import Any, Final, TypeVar

from sqlalchemy import (
    BigInteger,
    Float,
    ForeignKey,
    ForeignKeyConstraint,
    Index,
    Integer,
    LargeBinary,
    MetaData,
    String,
    Text,
    UniqueConstraint,
    text,
)
from sqlalchemy.orm import DeclarativeBase, Mapped, mapped_column
from sqlalchemy.types import TypeEngine

from valerie.access import Role
from valerie.db.column_types import JsonDocument, UtcMoment, words
from valerie.measures import ColumnType, Source, measures_from
from valerie.parameters.definitions import Value
from valerie.perception.documents.function import FunctionDocument
from valerie.rendering.annotations.kinds import AnnotationKind
from valerie.runs.forecasting.costs import Cost
from valerie.runs.marks import MarkKind
from valerie.runs.products.archive import Archive
from valerie.runs.products.pins import AnyOffer, AnyPins
from valerie.runs.products.progress import BlockCounts, Progress
from valerie.runs.products.ready import ProductError
from valerie.runs.products.states import Priority, ProductKind, ProductState, RunState, Stage
from valerie.runs.resolving.spec import RunSpec
from valerie.runs.study.study_document import Outcomes, StudyDocument, StudyResult, StudyState

#: The newest revision in migrations/, which has the tables below.
REVISION: Final = "clocks"
#: A constraint's name follows from its columns, so that migrations can name it on both databases.
NAMING = {
    "ix": "ix_%(table_name)s_%(column_0_N_name)s",
    "uq": "uq_%(table_name)s_%(column_0_N_name)s",
    "ck": "ck_%(table_name)s_%(constraint_name)s",
    "fk": "fk_%(table_name)s_%(column_0_N_name)s",
    "pk": "pk_%(table_name)s",
}
Digest = String(32)
#: Parameter path to value; angles in degrees.
Assignment = dict[str, Value]
_INPUT_COLUMNS = ("input_a", "input_b", "input_c")


def _partial(name: str, *columns: str, where: str) -> Index:
    """Return an index over some of the rows, the same on both databases."""
    return Index(name, *columns, sqlite_where=text(where), postgresql_where=text(where))


_SQL_TYPES: Final[Mapping[ColumnType, TypeEngine[Any]]] = {
    ColumnType.NAME: String(64),
    ColumnType.INT64: Integer(),
    ColumnType.FLOAT: Float(),
}
_Table = TypeVar("_Table", bound="Base")


class Base(DeclarativeBase):
    metadata = MetaData(naming_convention=NAMING)
    type_annotation_map = {  # noqa: RUF012
        datetime: UtcMoment(),
        RunState: words(RunState, 32),
        Priority: words(Priority, 16),
        ProductState: words(ProductState, 16),
        ProductKind: words(ProductKind, 16),
        AnnotationKind: words(AnnotationKind, 16),
        Stage: words(Stage, 16),
        StudyState: words(StudyState, 16),
        MarkKind: words(MarkKind, 16),
        Role: words(Role, 16),
    }


def _measured(*sources: Source) -> Callable[[type[_Table]], type[_Table]]:
    """Give a table one column, of the measure's name, for each measure from ``sources``."""

    def extend(table: type[_Table]) -> type[_Table]:
        for measure in measures_from(*sources):
            setattr(table, measure.name, mapped_column(_SQL_TYPES[measure.type], nullable=not measure.required))
        return table

    return extend


class Run(Base):
    """A validation run: its spec, its pins and its progress."""

    __tablename__ = "runs"

    id: Mapped[str] = mapped_column(String(32), primary_key=True)
    name: Mapped[str] = mapped_column(String(200))
    state: Mapped[RunState]
    #: Why the run is paused, waits or failed; shown to users verbatim.
    reason: Mapped[str | None] = mapped_column(Text)
    spec: Mapped[RunSpec] = mapped_column(JsonDocument(RunSpec))
    spec_digest: Mapped[str] = mapped_column(Digest)
    asset_digest: Mapped[str] = mapped_column(Digest)
    #: None until workers offer all that the spec needs.
    pins: Mapped[AnyPins | None] = mapped_column(JsonDocument(AnyPins))
    parent_run: Mapped[str | None] = mapped_column(ForeignKey("runs.id", ondelete="SET NULL"))
    iteration: Mapped[int] = mapped_column(default=0)
    variant_count: Mapped[int] = mapped_column(BigInteger)
    #: Variants 0 … next_index−1 have rows.
    next_index: Mapped[int] = mapped_column(BigInteger, default=0)
    rejected_count: Mapped[int] = mapped_column(BigInteger, default=0)
    priority: Mapped[Priority] = mapped_column(default=Priority.NORMAL)
    #: When it should be done; None: no matter when.
    deadline: Mapped[datetime | None]
    #: Turn of the next product that it wants.
    turn: Mapped[float] = mapped_column(Float, default=0.0)
    #: At the latest count of the control loop; None before the first.
    progress: Mapped[Progress | None] = mapped_column(JsonDocument(Progress))
    idempotency_key: Mapped[str | None] = mapped_column(String(200), unique=True)
    #: Owner of the token that submitted it; None: the operator.
    owner: Mapped[str | None] = mapped_column(String(200))
    #: Of the token that submitted it; empty: none.
    project: Mapped[str] = mapped_column(String(64), server_default="")
    #: Runs of one tenant share products; see `valerie.runs.products.inputs.ProductInputs`.
    tenant: Mapped[str] = mapped_column(String(64), server_default="")
    #: Of its products that were not stored when it was submitted; None where no quota asked for it.
    forecast: Mapped[Cost | None] = mapped_column(JsonDocument(Cost))
    #: Where its rows in other tables are, besides its marks; None: in the database.
    archive: Mapped[Archive | None] = mapped_column(JsonDocument(Archive))
    created_at: Mapped[datetime]
    started_at: Mapped[datetime | None]
    finished_at: Mapped[datetime | None]

    __table_args__ = (Index("ix_runs_state", "state"), Index("ix_runs_created_at", "created_at"))


class DeletedRun(Base):
    """What a deleted run took, which counts for quotas as long as if it were there."""

    __tablename__ = "deleted_runs"

    id: Mapped[str] = mapped_column(String(32), primary_key=True)
    owner: Mapped[str] = mapped_column(String(200))
    project: Mapped[str] = mapped_column(String(64))
    #: CPU time of the products that only this run of its owner and project needed.
    cpu_seconds: Mapped[float] = mapped_column(Float)
    #: End of the run, Unix seconds.
    finished_at: Mapped[float] = mapped_column(Float)


class FedBlock(Base):
    """A range of consecutive variants. A finished block is not counted again, which keeps progress cheap."""

    __tablename__ = "blocks"

    run_id: Mapped[str] = mapped_column(ForeignKey("runs.id", ondelete="CASCADE"), primary_key=True)
    number: Mapped[int] = mapped_column(primary_key=True)
    first: Mapped[int] = mapped_column(BigInteger)
    last: Mapped[int] = mapped_column(BigInteger)
    #: Final counts; None while unfinished.
    counts: Mapped[BlockCounts | None] = mapped_column(JsonDocument(BlockCounts))


class Variant(Base):
    """A point of the parameter space."""

    __tablename__ = "variants"

    run_id: Mapped[str] = mapped_column(ForeignKey("runs.id", ondelete="CASCADE"), primary_key=True)
    index: Mapped[int] = mapped_column(BigInteger, primary_key=True)
    block: Mapped[int]
    assignment: Mapped[Assignment] = mapped_column(JsonDocument(Assignment))
    #: Why the variant gets no frames, in words; None for an accepted variant.
    rejection: Mapped[str | None] = mapped_column(Text)


class Product(Base):
    """A computed artifact, addressed by the digest of its true inputs."""

    __tablename__ = "products"

    digest: Mapped[str] = mapped_column(Digest, primary_key=True)
    kind: Mapped[ProductKind]
    state: Mapped[ProductState]
    #: Queue of the workers that can make it: stage and numeric class.
    route: Mapped[str] = mapped_column(String(120))
    #: Products of one group share a warm cache (same asset, camera and light; same network).
    cache_group: Mapped[str] = mapped_column(Digest)
    #: Products that must be done first.
    input_a: Mapped[str | None] = mapped_column(Digest)
    input_b: Mapped[str | None] = mapped_column(Digest)
    input_c: Mapped[str | None] = mapped_column(Digest)
    #: In whose line it is; empty: the operator's. Ready products of a line are served by turn; see `valerie.runs.products.turns`.
    owner: Mapped[str] = mapped_column(String(200), server_default="")
    turn: Mapped[float] = mapped_column(Float, default=0.0)
    attempts: Mapped[int] = mapped_column(default=0)
    lease_owner: Mapped[str | None] = mapped_column(String(64))
    #: End of the lease, Unix seconds.
    lease_until: Mapped[float | None] = mapped_column(Float)
    #: Time of the last message; None after a transient failure, until it is sent again.
    sent_at: Mapped[float | None] = mapped_column(Float)
    #: Unix seconds: a ready product rests until then after a transient failure.
    not_before: Mapped[float | None] = mapped_column(Float)
    #: Why of a final failure.
    error: Mapped[ProductError | None] = mapped_column(JsonDocument(ProductError))
    bytes: Mapped[int | None] = mapped_column(BigInteger)
    pixels: Mapped[int | None] = mapped_column(BigInteger)
    cpu_seconds: Mapped[float | None] = mapped_column(Float)
    finished_at: Mapped[float | None] = mapped_column(Float)

    __table_args__ = (
        # Only waiting products are looked up by their inputs: the indexes are as small as the feeding window.
        *(_partial(f"ix_products_{column}", column, where="state = 'waiting'") for column in _INPUT_COLUMNS),
        # The sweeper and the window read only unfinished products: the index stays small in a large table.
        # Workers take the ready products of a route by owner and turn.
        _partial(
            "ix_products_unfinished",
            *("state", "route", "owner", "turn"),
            where="state IN ('waiting','ready','running')",
        ),
        # For sums over all ended products, and for the newest of each kind, without reading rows.
        _partial(
            "ix_products_ended", "kind", "state", "finished_at", "cpu_seconds", where="state IN ('done','failed')"
        ),
    )


class OwnerTurn(Base):
    """How far a queue has served the products of an owner; see `valerie.db.claiming.claim_next`."""

    __tablename__ = "owner_turns"

    route: Mapped[str] = mapped_column(String(120), primary_key=True)
    owner: Mapped[str] = mapped_column(String(200), primary_key=True)
    #: The owner's turn when it was served last, and its next one.
    start: Mapped[float] = mapped_column(Float)
    turn: Mapped[float] = mapped_column(Float)


def _existing_frame(name: str) -> ForeignKeyConstraint:
    """Return the constraint that a row's frame exists, and that the row goes with it."""
    keys = ["run_id", "variant_index", "camera_index", "time_index"]
    return ForeignKeyConstraint(keys, [f"frames.{key}" for key in keys], ondelete="CASCADE", name=name)


class Frame(Base):
    """A frame (variant, camera, time index) and its products."""

    __tablename__ = "frames"

    run_id: Mapped[str] = mapped_column(String(32), primary_key=True)
    variant_index: Mapped[int] = mapped_column(BigInteger, primary_key=True)
    camera_index: Mapped[int] = mapped_column(primary_key=True)
    time_index: Mapped[int] = mapped_column(primary_key=True, default=0)
    background: Mapped[str] = mapped_column(Digest)
    layer: Mapped[str] = mapped_column(Digest)
    truth: Mapped[str] = mapped_column(Digest)
    #: Why the run no longer keeps its pictures; None: it does.
    removed: Mapped[str | None] = mapped_column(String(64))

    __table_args__ = (
        ForeignKeyConstraint(
            ["run_id", "variant_index"],
            ["variants.run_id", "variants.index"],
            ondelete="CASCADE",
            name="fk_frames_variant",
        ),
        Index("ix_frames_background", "background"),
        Index("ix_frames_layer", "layer"),
        Index("ix_frames_truth", "truth"),
    )


class Evaluation(Base):
    """An evaluation (frame, sensor setting, function) and its products."""

    __tablename__ = "evaluations"

    run_id: Mapped[str] = mapped_column(String(32), primary_key=True)
    variant_index: Mapped[int] = mapped_column(BigInteger, primary_key=True)
    camera_index: Mapped[int] = mapped_column(primary_key=True)
    time_index: Mapped[int] = mapped_column(primary_key=True, default=0)
    sensor_index: Mapped[int] = mapped_column(primary_key=True)
    function_index: Mapped[int] = mapped_column(primary_key=True)
    prediction: Mapped[str] = mapped_column(Digest)
    scores: Mapped[str] = mapped_column(Digest)
    #: The prediction for the background without movables, for `pacc_empty`; None if the run does not make it.
    empty: Mapped[str | None] = mapped_column(Digest)
    #: True if the sensor distorts: rows of `PersonView` for its pictures then name ``scores``, not the frame's truth.
    distorted: Mapped[bool] = mapped_column(default=False)

    __table_args__ = (
        _existing_frame("fk_evaluations_frame"),
        Index("ix_evaluations_prediction", "prediction"),
        Index("ix_evaluations_scores", "scores"),
        Index("ix_evaluations_empty", "empty"),
    )


class FrameAnnotation(Base):
    """An annotation of a frame, and its product."""

    __tablename__ = "frame_annotations"

    run_id: Mapped[str] = mapped_column(String(32), primary_key=True)
    variant_index: Mapped[int] = mapped_column(BigInteger, primary_key=True)
    camera_index: Mapped[int] = mapped_column(primary_key=True)
    time_index: Mapped[int] = mapped_column(primary_key=True, default=0)
    kind: Mapped[AnnotationKind] = mapped_column(primary_key=True)
    product: Mapped[str] = mapped_column(Digest)

    __table_args__ = (
        _existing_frame("fk_frame_annotations_frame"),
        Index("ix_frame_annotations_product", "product"),
    )


@_measured(Source.PLACE, Source.PIXELS)
class PersonView(Base):
    """Visibility of one person in one truth product; a row with instance 0 stands for a scene without persons.

    If the sensor distorts, ``truth`` is an evaluation product: its rows describe the truth as that sensor sees it.
    """

    __tablename__ = "person_views"

    truth: Mapped[str] = mapped_column(ForeignKey("products.digest", ondelete="CASCADE"), primary_key=True)
    instance_id: Mapped[int] = mapped_column(primary_key=True)
    #: x0, y0, x1, y1 in pixels, end exclusive; None if no pixel is visible.
    box: Mapped[list[int] | None] = mapped_column(JsonDocument(list[int]))
    amodal_box: Mapped[list[int] | None] = mapped_column(JsonDocument(list[int]))


@_measured(Source.LIGHT)
class PersonLight(Base):
    """Light on one person in one frame, and the person's contrast; part of a product of kind ``light``."""

    __tablename__ = "person_lights"

    product: Mapped[str] = mapped_column(ForeignKey("products.digest", ondelete="CASCADE"), primary_key=True)
    instance_id: Mapped[int] = mapped_column(primary_key=True)


@_measured(Source.PICTURE)
class Picture(Base):
    """Grey levels of the picture behind a prediction; part of a product of kind ``prediction``."""

    __tablename__ = "pictures"

    prediction: Mapped[str] = mapped_column(ForeignKey("products.digest", ondelete="CASCADE"), primary_key=True)


@_measured(Source.FRAME_SCORE)
class Score(Base):
    """Counts of one function on one frame, and the ratios that follow from them."""

    __tablename__ = "scores"

    digest: Mapped[str] = mapped_column(ForeignKey("products.digest", ondelete="CASCADE"), primary_key=True)
    #: (19, 20) int64 little-endian, zstd: rows truth, columns prediction, last column void.
    confusion: Mapped[bytes] = mapped_column(LargeBinary)
    tp: Mapped[int]
    fn: Mapped[int]
    tn: Mapped[int]
    pacc: Mapped[float | None] = mapped_column(Float)


@_measured(Source.PERSON_SCORE)
class PersonScore(Base):
    """tp and fn of one person in one evaluation."""

    __tablename__ = "person_scores"

    digest: Mapped[str] = mapped_column(ForeignKey("products.digest", ondelete="CASCADE"), primary_key=True)
    instance_id: Mapped[int] = mapped_column(primary_key=True)


class Study(Base):
    """A question with a budget; its batches are runs."""

    __tablename__ = "studies"

    id: Mapped[str] = mapped_column(String(32), primary_key=True)
    name: Mapped[str] = mapped_column(String(200))
    state: Mapped[StudyState]
    #: What the study waits for, or why it ended; shown to users verbatim.
    reason: Mapped[str | None] = mapped_column(Text)
    document: Mapped[StudyDocument] = mapped_column(JsonDocument(StudyDocument))
    asset_digest: Mapped[str] = mapped_column(Digest)
    #: True if a person accepts each batch.
    by_hand: Mapped[bool]
    #: Result of the batches that have ended; None before the first.
    result: Mapped[StudyResult | None] = mapped_column(JsonDocument(StudyResult))
    #: Owner of the token that began it; None: the operator. It is also the owner of its runs.
    owner: Mapped[str | None] = mapped_column(String(200))
    #: As of runs; it is also the project of its runs.
    project: Mapped[str] = mapped_column(String(64), server_default="")
    created_at: Mapped[datetime]
    finished_at: Mapped[datetime | None]

    __table_args__ = (Index("ix_studies_created_at", "created_at"),)


class StudyBatch(Base):
    """A proposal of a study, its run and its outcomes."""

    __tablename__ = "study_batches"

    study_id: Mapped[str] = mapped_column(ForeignKey("studies.id", ondelete="CASCADE"), primary_key=True)
    number: Mapped[int] = mapped_column(primary_key=True)
    #: Number of points requested from the strategy; the proposal may have fewer.
    count: Mapped[int]
    #: (n, dimensions) in the unit cube.
    points: Mapped[list[list[float]]] = mapped_column(JsonDocument(list[list[float]]))
    #: Indexes of the points whose variants are rejected.
    rejected: Mapped[list[int]] = mapped_column(JsonDocument(list[int]))
    #: Why these points, in words.
    reason: Mapped[str] = mapped_column(Text)
    #: Digest of the study and of all outcomes behind the proposal: those of the batches before ``based_on``.
    basis: Mapped[str] = mapped_column(Digest)
    based_on: Mapped[int]
    #: None until the batch is accepted.
    accepted_at: Mapped[datetime | None]
    run_id: Mapped[str | None] = mapped_column(ForeignKey("runs.id", ondelete="SET NULL"))
    #: Number of retries of its run after products failed.
    retries: Mapped[int] = mapped_column(default=0)
    #: None until the run has ended with every score.
    outcomes: Mapped[Outcomes | None] = mapped_column(JsonDocument(Outcomes))
    cpu_seconds: Mapped[float | None] = mapped_column(Float)

    __table_args__ = (Index("ix_study_batches_run_id", "run_id"),)


class Function(Base):
    """A version of a registered function under test. Rows are written once and never changed."""

    __tablename__ = "functions"

    name: Mapped[str] = mapped_column(String(64), primary_key=True)
    #: Digest of the document without its name; see `valerie.perception.documents.function.FunctionDocument`.
    digest: Mapped[str] = mapped_column(Digest, primary_key=True)
    #: Counts the versions of a name; the highest is the newest.
    version: Mapped[int]
    document: Mapped[FunctionDocument] = mapped_column(JsonDocument(FunctionDocument))
    #: SHA-256 of the payload in the artifact store; None for kinds without one.
    payload: Mapped[str | None] = mapped_column(String(64))
    created_at: Mapped[datetime]

    __table_args__ = (
        UniqueConstraint("name", "version"),
        Index("ix_functions_digest", "digest"),
        Index("ix_functions_payload", "payload"),
    )


class SavedSelection(Base):
    """A named selection of rows of runs, and how a page shows it."""

    __tablename__ = "selections"

    #: Of the token that saved it; empty: none.
    project: Mapped[str] = mapped_column(String(64), primary_key=True, server_default="")
    name: Mapped[str] = mapped_column(String(120), primary_key=True)
    #: Ids of the runs, which may have been deleted since.
    runs: Mapped[tuple[str, ...]] = mapped_column(JsonDocument(tuple[str, ...]))
    #: The expression; empty: all rows.
    expression: Mapped[str] = mapped_column(Text)
    #: The query of the page's address.
    view: Mapped[str] = mapped_column(Text)
    created_at: Mapped[datetime]


class Note(Base):
    """A note about a run or a part of it, empty if there are only tags. It is deleted with the run."""

    __tablename__ = "notes"

    run_id: Mapped[str] = mapped_column(ForeignKey("runs.id", ondelete="CASCADE"), primary_key=True)
    kind: Mapped[MarkKind] = mapped_column(primary_key=True)
    #: See `valerie.runs.marks.Subject`.
    name: Mapped[str] = mapped_column(String(1000), primary_key=True)
    text: Mapped[str] = mapped_column(Text)
    changed_at: Mapped[datetime]


class MarkTag(Base):
    """A tag of a mark."""

    __tablename__ = "tags"

    run_id: Mapped[str] = mapped_column(ForeignKey("runs.id", ondelete="CASCADE"), primary_key=True)
    kind: Mapped[MarkKind] = mapped_column(primary_key=True)
    name: Mapped[str] = mapped_column(String(1000), primary_key=True)
    tag: Mapped[str] = mapped_column(String(40), primary_key=True)

    __table_args__ = (Index("ix_tags_tag", "tag"),)


class Delivery(Base):
    """The state of telling a receiver of webhooks that a run ended; no row before the first attempt."""

    __tablename__ = "deliveries"

    run_id: Mapped[str] = mapped_column(ForeignKey("runs.id", ondelete="CASCADE"), primary_key=True)
    #: A resumed run ends again.
    ended_at: Mapped[datetime] = mapped_column(primary_key=True)
    #: See `valerie.pipeline.control.webhooks.receiver_of`.
    receiver: Mapped[str] = mapped_column(String(64), primary_key=True)
    attempts: Mapped[int]
    #: Unix seconds of the next attempt; None: delivered.
    due_at: Mapped[float | None] = mapped_column(Float)
    #: Why the last attempt failed; None: delivered.
    problem: Mapped[str | None] = mapped_column(Text)


class Token(Base):
    """A token of the API. It is never deleted, so that its name keeps its meaning."""

    __tablename__ = "tokens"

    name: Mapped[str] = mapped_column(String(64), primary_key=True)
    #: SHA-256 of the secret; see `valerie.access.digest_of`.
    digest: Mapped[str] = mapped_column(String(64), unique=True)
    owner: Mapped[str] = mapped_column(String(200))
    role: Mapped[Role]
    #: See `valerie.access.Caller`.
    project: Mapped[str] = mapped_column(String(64), server_default="")
    #: Names of areas with spaces between them; see `valerie.access.Caller`.
    scopes: Mapped[str] = mapped_column(String(400), server_default="")
    created_at: Mapped[datetime]
    expires_at: Mapped[datetime]
    revoked_at: Mapped[datetime | None]
    used_at: Mapped[datetime | None]


class AuditEntry(Base):
    """A change that a caller asked for: one row before it, and one with its outcome. Rows are neither changed nor deleted."""

    __tablename__ = "audit"

    id: Mapped[int] = mapped_column(BigInteger().with_variant(Integer(), "sqlite"), primary_key=True)
    #: The same in both rows of a request.
    request: Mapped[str] = mapped_column(String(16))
    at: Mapped[datetime]
    #: See `valerie.access.Caller`; None: the request had no valid token.
    caller: Mapped[str | None] = mapped_column(String(64))
    owner: Mapped[str | None] = mapped_column(String(200))
    role: Mapped[Role | None]
    address: Mapped[str] = mapped_column(String(64))
    method: Mapped[str] = mapped_column(String(16))
    path: Mapped[str] = mapped_column(String(1000))
    #: Status of the answer; None in the row before the change.
    status: Mapped[int | None]
    #: Refusals before this one that were too many to be kept.
    left_out: Mapped[int] = mapped_column(default=0)


class Worker(Base):
    """A worker process and its offers."""

    __tablename__ = "workers"

    id: Mapped[str] = mapped_column(String(64), primary_key=True)
    stage: Mapped[Stage]
    host: Mapped[str] = mapped_column(String(200))
    pid: Mapped[int]
    offers: Mapped[tuple[AnyOffer, ...]] = mapped_column(JsonDocument(tuple[AnyOffer, ...]))
    started_at: Mapped[float] = mapped_column(Float)
    #: Unix seconds of the last heartbeat.
    seen_at: Mapped[float] = mapped_column(Float)
    #: Why the worker was put aside; None: it works.
    resting: Mapped[str | None] = mapped_column(Text)
    #: Seconds that its clock was ahead of the database's at the last heartbeat; None: a worker of an older release.
    clock_ahead: Mapped[float | None] = mapped_column(Float)


class Specimen(Base):
    """What a numeric class makes of a fixed scene or picture (`valerie.runs.products.specimens`)."""

    __tablename__ = "specimens"

    key: Mapped[str] = mapped_column(String(32), primary_key=True)
    data: Mapped[bytes] = mapped_column(LargeBinary)


class Lease(Base):
    """A named role that one process holds at a time, such as the control loop."""

    __tablename__ = "leases"

    name: Mapped[str] = mapped_column(String(64), primary_key=True)
    owner: Mapped[str] = mapped_column(String(64))
    until: Mapped[float] = mapped_column(Float)
