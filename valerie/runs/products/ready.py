"""Documents about products that the parts of the pipeline exchange."""

from __future__ import annotations

from typing import NamedTuple

from valerie.runs.products.states import ProductKind
from valerie.runs.values import Document


class Ready(NamedTuple):
    """A product that can be claimed: what a message about it needs.

    Attributes:
        digest: names the product.
        kind: what it is.
        route: queue of the workers that can make it.
        cache_group: products of one group share a warm cache.
        turn: products of one route, kind, group and turn are taken together (see `valerie.runs.products.turns`).
    """

    digest: str
    kind: ProductKind
    route: str
    cache_group: str
    turn: float


class Fault(Document):
    """Why a product failed for good.

    Attributes:
        stage: kind of the product that failed.
        type: name of the error's class.
        message: the error, in words.
        attempts: how often it was tried.
    """

    stage: ProductKind
    type: str
    message: str
    attempts: int


class FailedInput(Document):
    """A product failed because one of its inputs did; ``cause`` is that input's digest."""

    cause: str


ProductError = Fault | FailedInput
