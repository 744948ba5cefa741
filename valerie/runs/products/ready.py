"""Documents about products that the parts of the pipeline exchange."""

from __future__ import annotations

from typing import NamedTuple

from valerie.document import Document
from valerie.runs.products.states import ProductKind


class Ready(NamedTuple):
    """A product that can be claimed, with the data for a message about it.

    Attributes:
        digest: digest of the product.
        kind: its kind.
        route: queue of the workers that can make it.
        cache_group: group of products that share a warm cache.
        turn: products of one route, kind, group and turn are taken together (see `valerie.runs.products.turns`).
    """

    digest: str
    kind: ProductKind
    route: str
    cache_group: str
    turn: float


class Fault(Document):
    """Error of a product that failed for good.

    Attributes:
        stage: kind of the product that failed.
        type: name of the error's class.
        message: text of the error.
        attempts: number of attempts.
    """

    stage: ProductKind
    type: str
    message: str
    attempts: int


class FailedInput(Document):
    """Error of a product one of whose inputs failed; ``cause`` is the input's digest."""

    cause: str


ProductError = Fault | FailedInput
