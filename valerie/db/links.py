"""Expressions about frames and their links, for the conditions, joins and columns of queries."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any, Final

from sqlalchemy import (
    BindParameter,
    ColumnElement,
    Connection,
    Select,
    Subquery,
    and_,
    bindparam,
    exists,
    or_,
    select,
    tuple_,
    union,
)
from sqlalchemy.orm import aliased

from valerie.db.archives import stored_in_archives
from valerie.db.models import (
    Assignment,
    Evaluation,
    Frame,
    FrameAnnotation,
    PersonLight,
    PersonView,
    Product,
    Run,
    Variant,
)
from valerie.rendering.annotations.kinds import AnnotationKind
from valerie.runs.products.frame_keys import FrameKey, FrameProducts

#: A table whose rows name a frame.
OfFrames = type[Frame] | type[Evaluation] | type[FrameAnnotation]

#: Tables and their columns that link a frame to a picture, a truth, an annotation or a prediction, in the order of the stages.
PICTURE_LINKS: Final[tuple[tuple[OfFrames, Any], ...]] = (
    (Frame, Frame.background),
    (Frame, Frame.layer),
    (Frame, Frame.truth),
    (FrameAnnotation, FrameAnnotation.product),
    (Evaluation, Evaluation.prediction),
    (Evaluation, Evaluation.empty),
)
#: All links of a frame to products.
PRODUCT_LINKS: Final = (*PICTURE_LINKS, (Evaluation, Evaluation.scores))

#: The background, layer and truth of a frame, in a query that `with_products` has joined.
BACKGROUND, LAYER, TRUTH = aliased(Product), aliased(Product), aliased(Product)
#: Joins a frame with its variant.
VARIANT_OF_FRAME = and_(Variant.run_id == Frame.run_id, Variant.index == Frame.variant_index)


def links_of(run_id: str | BindParameter[str]) -> Subquery:
    """Return the digests of the products that a run links to, each once."""
    return union(*(select(column).where(table.run_id == run_id) for table, column in PRODUCT_LINKS)).subquery()


def with_products(query: Select[*tuple[Any, ...]]) -> Select[*tuple[Any, ...]]:
    """Join a query of frames with their backgrounds, layers and truths."""
    for product, column in ((BACKGROUND, Frame.background), (LAYER, Frame.layer), (TRUTH, Frame.truth)):
        query = query.join(product, product.digest == column)
    return query


def has_product(connection: Connection, digest: str, *, project: str) -> bool:
    """Return True if a frame of one of the project's runs links to a product, or an archived one stores it."""
    linked = (
        exists().where(column == digest, table.run_id == Run.id, Run.project == project)
        for table, column in PRODUCT_LINKS
    )
    return bool(connection.scalar(select(or_(*linked))) or stored_in_archives(connection, [digest], project=project))


def same_frame(table: OfFrames) -> ColumnElement[bool]:
    """Return the condition that a row of ``table`` and one of `Frame` name the same frame."""
    return and_(
        table.run_id == Frame.run_id,
        table.variant_index == Frame.variant_index,
        table.camera_index == Frame.camera_index,
        table.time_index == Frame.time_index,
    )


#: Joins a frame with its light, if its run annotates light.
LIGHT_OF_FRAME = and_(same_frame(FrameAnnotation), FrameAnnotation.kind == AnnotationKind.LIGHT.value)
LIGHT_OF_PERSON = and_(
    PersonLight.product == FrameAnnotation.product, PersonLight.instance_id == PersonView.instance_id
)


def names_frame(table: OfFrames) -> ColumnElement[bool]:
    """Return the condition that a row of ``table`` names the frame of `frame_values`."""
    return and_(
        table.run_id == bindparam("run_id"),
        table.variant_index == bindparam("variant"),
        table.camera_index == bindparam("camera"),
        table.time_index == bindparam("time"),
    )


def frame_values(key: FrameKey) -> dict[str, str | int]:
    """Return the values of the parameters of `names_frame`."""
    return asdict(key)


def among_frames(table: OfFrames, keys: Iterable[FrameKey]) -> ColumnElement[bool]:
    """Return the condition that a row of ``table`` names one of some frames of one run."""
    keys = list(keys)
    places = [(key.variant, key.camera, key.time) for key in keys]
    return and_(table.run_id.in_({key.run_id for key in keys}), tuple_(*frame_order(table)).in_(places))


def frame_order(table: OfFrames) -> tuple[Any, Any, Any]:
    """Return the columns that sort the frames of one run."""
    return table.variant_index, table.camera_index, table.time_index


def key_of(run_id: str, row: Any) -> FrameKey:
    """Return the frame that a query's row names."""
    return FrameKey(run_id, row.variant_index, row.camera_index, row.time_index)


def _annotation_of_frame(kind: AnnotationKind) -> Any:
    """Return a column, named by the kind: the digest of this annotation of the frame that a query reads, or NULL."""
    return (
        select(FrameAnnotation.product)
        .where(same_frame(FrameAnnotation), FrameAnnotation.kind == kind.value)
        .correlate(Frame)
        .scalar_subquery()
        .label(kind.value)
    )


#: The columns of a `StoredFrame`, for a query that joins frames and variants.
FRAME_COLUMNS = (
    Frame.run_id,
    *frame_order(Frame),
    Frame.background,
    Frame.layer,
    Frame.truth,
    Frame.removed,
    _annotation_of_frame(AnnotationKind.VELOCITY),
    _annotation_of_frame(AnnotationKind.SCAN),
    Variant.assignment,
)


@dataclass(frozen=True, slots=True)
class StoredFrame:
    """The row of a frame.

    Attributes:
        key: the frame.
        products: its picture, truth, velocities and scan.
        assignment: parameter path to value, of its variant.
        removed: why its run no longer keeps its pictures; None: it does.
    """

    key: FrameKey
    products: FrameProducts
    assignment: Assignment
    removed: str | None = None

    @classmethod
    def of(cls, row: Any) -> StoredFrame:
        """Read the frame from a row with the columns `FRAME_COLUMNS`."""
        products = FrameProducts(row.background, row.layer, row.truth, row.velocity, row.scan)
        return cls(key_of(row.run_id, row), products, row.assignment, row.removed)
