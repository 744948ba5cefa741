"""Queries about the frames of a run: their products, annotations and persons."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from functools import partial
from itertools import groupby
from typing import Any, Final, NamedTuple

from sqlalchemy import BigInteger, Connection, literal, select, tuple_

from valerie.db.links import (
    BACKGROUND,
    FRAME_COLUMNS,
    LAYER,
    LIGHT_OF_FRAME,
    LIGHT_OF_PERSON,
    TRUTH,
    VARIANT_OF_FRAME,
    StoredFrame,
    among_frames,
    frame_order,
    frame_values,
    key_of,
    names_frame,
    with_products,
)
from valerie.db.long_table import COLUMNS
from valerie.db.measured import LIT, SEEN, SeenPerson
from valerie.db.models import Frame, FrameAnnotation, PersonLight, PersonView, Product, Variant
from valerie.db.rows import required
from valerie.runs.products.frame_keys import FrameKey
from valerie.runs.products.states import ProductState

#: The query of all columns of frames.
_FRAMES: Final = select(*FRAME_COLUMNS).select_from(Frame).join(Variant, VARIANT_OF_FRAME)
#: Built once: building it takes longer than running it.
_GET: Final = _FRAMES.where(names_frame(Frame))


def get(connection: Connection, key: FrameKey) -> StoredFrame:
    """Read one frame.

    Raises:
        NotFound: no such frame.
    """
    return StoredFrame.of(required(connection.execute(_GET, frame_values(key)).first(), "frame", key))


def several(connection: Connection, keys: Collection[FrameKey]) -> dict[FrameKey, StoredFrame]:
    """Read frames of one run; unknown ones are left out."""
    found = map(StoredFrame.of, connection.execute(_FRAMES.where(among_frames(Frame, keys))))
    return {frame.key: frame for frame in found}


class ListedFrame(NamedTuple):
    """A frame, and the states of its background, layer and truth."""

    frame: StoredFrame
    states: tuple[ProductState, ...]


def page(connection: Connection, run_id: str, *, after: FrameKey | None = None, limit: int) -> list[ListedFrame]:
    """Read the frames of a run after ``after``, in order."""
    query = (
        with_products(_FRAMES.add_columns(*(product.state for product in (BACKGROUND, LAYER, TRUTH))))
        .where(Frame.run_id == run_id)
        .order_by(*frame_order(Frame))
        .limit(limit)
    )
    if after is not None:
        query = query.where(tuple_(*frame_order(Frame)) > _place(after))
    return [ListedFrame(StoredFrame.of(row), row[len(FRAME_COLUMNS) :]) for row in connection.execute(query)]


def _place(key: FrameKey) -> Any:
    """Return a frame's position in its run, for comparison with `frame_order`."""
    return tuple_(*(literal(part, BigInteger) for part in (key.variant, key.camera, key.time)))


def finished(connection: Connection, run_id: str) -> Iterator[tuple[StoredFrame, tuple[SeenPerson, ...]]]:
    """Read the frames whose image and truth are stored, in order, each with its persons and the light on them.

    A frame without persons yields one with instance 0.
    """
    of_person = (PersonView.instance_id, PersonView.box, PersonView.amodal_box)
    measures = (COLUMNS[name] for name in (*SEEN, *LIT))
    query = (
        with_products(_FRAMES.add_columns(*of_person, *measures))
        .join(PersonView, PersonView.truth == Frame.truth)
        .outerjoin(FrameAnnotation, LIGHT_OF_FRAME)
        .outerjoin(PersonLight, LIGHT_OF_PERSON)
        .where(Frame.run_id == run_id, *(product.state == ProductState.DONE for product in (BACKGROUND, LAYER, TRUTH)))
        .order_by(*frame_order(Frame), PersonView.instance_id)
    )
    rows = connection.execution_options(yield_per=5_000).execute(query)
    for _, group in groupby(rows, partial(key_of, run_id)):
        members = list(group)
        persons = (member[len(FRAME_COLUMNS) :] for member in members)
        yield (
            StoredFrame.of(members[0]),
            tuple(
                SeenPerson(number, dict(zip((*SEEN, *LIT), values, strict=True)), box, amodal)
                for number, box, amodal, *values in persons
            ),
        )


def neighbours(connection: Connection, key: FrameKey) -> tuple[FrameKey | None, FrameKey | None]:
    """Return the frames before and after ``key``, in the order of `page`; None at the ends."""
    columns, here = frame_order(Frame), _place(key)

    def nearest(condition: Any, order: list[Any]) -> FrameKey | None:
        query = select(*columns).where(Frame.run_id == key.run_id, condition).order_by(*order).limit(1)
        row = connection.execute(query).first()
        return None if row is None else key_of(key.run_id, row)

    return (
        nearest(tuple_(*columns) < here, [column.desc() for column in columns]),
        nearest(tuple_(*columns) > here, [column.asc() for column in columns]),
    )


def variants_with_frame(connection: Connection, key: FrameKey, variants: Iterable[int]) -> set[int]:
    """Return those of some variants that have a frame of the same camera and time."""
    query = select(Frame.variant_index).where(
        Frame.run_id == key.run_id,
        Frame.camera_index == key.camera,
        Frame.time_index == key.time,
        Frame.variant_index.in_(list(variants)),
    )
    return set(connection.scalars(query))


class AnnotationLink(NamedTuple):
    """An annotation of a frame: its product and that product's state."""

    product: str
    state: ProductState


def annotation_links(connection: Connection, key: FrameKey) -> dict[str, AnnotationLink]:
    """Read the annotations of one frame by kind."""
    rows = connection.execute(
        select(FrameAnnotation.kind, FrameAnnotation.product, Product.state)
        .join(Product, Product.digest == FrameAnnotation.product)
        .where(names_frame(FrameAnnotation))
        .order_by(FrameAnnotation.kind),
        frame_values(key),
    )
    return {kind: AnnotationLink(product, state) for kind, product, state in rows}
