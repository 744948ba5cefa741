"""Products whose artifacts are stored, and the rows that describe their content."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Final

from sqlalchemy import Connection, bindparam, select, update

from valerie.db.claiming import held
from valerie.db.measured import FrameScore, MeasuredPerson, SeenPerson
from valerie.db.models import Base, PersonLight, PersonScore, PersonView, Picture, Product, Score
from valerie.db.statements import UNLEASED, Values, insert_ignoring, lock
from valerie.measures import Measures
from valerie.runs.products.states import ProductKind, ProductState


@dataclass(frozen=True, slots=True)
class Finished:
    """A product whose artifact is stored, with the rows that describe its content.

    Attributes:
        digest: the product.
        bytes, pixels: size of the object, and of the image.
        cpu_seconds: CPU time of making it.
        person_views, person_lights, picture, score, person_scores: rows of the tables of these names.
        part: the statics that a truth is stored over.
    """

    digest: str
    bytes: int
    pixels: int
    cpu_seconds: float
    person_views: tuple[SeenPerson, ...] = ()
    person_lights: tuple[MeasuredPerson, ...] = ()
    picture: Measures | None = None
    score: FrameScore | None = None
    person_scores: tuple[MeasuredPerson, ...] = ()
    part: SharedStatics | None = None


@dataclass(frozen=True, slots=True)
class SharedStatics:
    """The statics that several truths are stored over; its row keeps it from being freed while one of them exists.

    Attributes:
        digest: digest of the content.
        bytes, pixels: size of the object, and of the image.
    """

    digest: str
    bytes: int
    pixels: int


_DONE: Final = (
    update(Product.__table__)  # type: ignore[arg-type]
    .where(Product.__table__.c.digest == bindparam("product"))
    .values(
        state=ProductState.DONE,
        **UNLEASED,
        error=None,
        bytes=bindparam("size"),
        pixels=bindparam("area"),
        cpu_seconds=bindparam("cpu"),
        finished_at=bindparam("now"),
    )
)


def publish(connection: Connection, finished: Sequence[Finished], *, owner: str, now: float) -> list[str]:
    """Mark products done and write their rows.

    Only products that ``owner`` still holds are published. The leases of the others ended: other workers make them, with
    equal bytes, or nothing links to them any more and they may have been freed.

    Returns:
        The digests that were published.
    """
    digests = [product.digest for product in finished]
    lock(connection, digests)  # a product keeps its holder until its rows are written
    query = select(Product.digest).where(*held(connection.dialect.name))
    still_held = set(connection.scalars(query, {"digests": digests, "holder": owner}))
    published = [product for product in finished if product.digest in still_held]
    if not published:
        return []
    connection.execute(
        _DONE,
        [{"product": p.digest, "size": p.bytes, "area": p.pixels, "cpu": p.cpu_seconds, "now": now} for p in published],
    )
    _publish_parts(connection, published, now)
    contents: dict[type[Base], list[Values]] = {
        PersonView: [{"truth": p.digest, **person.columns} for p in published for person in p.person_views],
        PersonLight: [{"product": p.digest, **person.columns} for p in published for person in p.person_lights],
        Picture: [{"prediction": p.digest, **p.picture} for p in published if p.picture is not None],
        Score: [{"digest": p.digest, **p.score.columns} for p in published if p.score is not None],
        PersonScore: [{"digest": p.digest, **person.columns} for p in published for person in p.person_scores],
    }
    for table, rows in contents.items():
        insert_ignoring(connection, table, rows)
    return [product.digest for product in published]


def _publish_parts(connection: Connection, published: Sequence[Finished], now: float) -> None:
    """Make each part an input of its product. No worker makes a part separately: the product's maker stores it again."""
    parts = {product.digest: product.part for product in published if product.part is not None}
    if not parts:
        return
    row = {
        "kind": ProductKind.STATICS,
        "state": ProductState.DONE,
        "route": "",
        "cache_group": "",
        "turn": 0.0,
        "attempts": 1,
        "cpu_seconds": 0.0,
        "finished_at": now,
    }
    # Sorted: two workers that insert the same ones wait for each other in any other order.
    distinct = sorted({part.digest: part for part in parts.values()}.values(), key=attrgetter("digest"))
    rows = [{**row, "digest": part.digest, "bytes": part.bytes, "pixels": part.pixels} for part in distinct]
    insert_ignoring(connection, Product, rows)
    table = Product.__table__
    connection.execute(
        update(table).where(table.c.digest == bindparam("product")).values(input_a=bindparam("part")),  # type: ignore[arg-type]
        [{"product": digest, "part": part.digest} for digest, part in parts.items()],
    )
