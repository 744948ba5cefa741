"""Cost of a product in CPU seconds and bytes: recorded by this installation, or from a table that ships with the package.

The shipped table (``costs.json``) contains measurements and names the machine. Costs are linear in the number of pixels:
``fixed + per_megapixel · megapixels``.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from enum import StrEnum
from functools import cache
from importlib.resources import files
from typing import NamedTuple

from valerie.document import Document
from valerie.runs.products.states import ProductKind


class CostBasis(StrEnum):
    """The source of a cost."""

    #: Products of the same kind, maker and resolution that this installation computed.
    RECORDED = "recorded"
    #: The table that ships with the package, measured on another machine.
    SHIPPED = "shipped"
    #: The most expensive entry of its kind in the shipped table, for an engine or function without an entry.
    GUESSED = "guessed"


class CostKey(NamedTuple):
    """The properties of a product that its cost depends on.

    Attributes:
        kind: kind of the product.
        maker: engine of backgrounds and layers, function of predictions; otherwise empty.
        width, height: resolution in pixels.
    """

    kind: ProductKind
    maker: str
    width: int
    height: int


class Cost(NamedTuple):
    """The cost of one product."""

    cpu_seconds: float
    bytes: float

    @classmethod
    def total(cls, costs: Iterable[Cost]) -> Cost:
        """Return the sum of costs."""
        costs = list(costs)
        return cls(sum(cost.cpu_seconds for cost in costs), sum(cost.bytes for cost in costs))


class CostTable:
    """Costs by key.

    Args:
        recorded: means over the products that this installation computed.
        few: means over too few products, which apply only where the shipped table has no entry: the first product of a
            worker includes loading.
    """

    def __init__(
        self, recorded: Mapping[CostKey, Cost] | None = None, few: Mapping[CostKey, Cost] | None = None
    ) -> None:
        self._recorded, self._few = dict(recorded or {}), dict(few or {})

    def cost(self, key: CostKey) -> tuple[Cost, CostBasis]:
        """Return the cost of one product and its source."""
        if key in self._recorded:
            return self._recorded[key], CostBasis.RECORDED
        megapixels = key.width * key.height / 1e6
        makers = _shipped().costs[key.kind]
        if key.maker in makers:
            return makers[key.maker].at(megapixels), CostBasis.SHIPPED
        if key in self._few:
            return self._few[key], CostBasis.RECORDED
        return max(line.at(megapixels) for line in makers.values()), CostBasis.GUESSED

    def statics(self, width: int, height: int) -> Cost:
        """Return the cost of the truth of the statics, which the truths of one camera share."""
        return _shipped().statics.at(width * height / 1e6)

    def thumbnail(self, width: int, height: int) -> Cost:
        """Return the cost of a thumbnail that remains of a picture of this size."""
        return _shipped().thumbnail.at(width * height / 1e6)

    @property
    def start_seconds(self) -> float:
        """CPU seconds of a run on one machine for starting, loading the asset and writing results."""
        return _shipped().start.cpu_seconds

    @property
    def machine(self) -> str:
        """The machine that the shipped table was measured on."""
        return _shipped().machine


class _Line(Document):
    """A cost as a line over the size of the image."""

    cpu_seconds: float
    cpu_seconds_per_megapixel: float
    bytes: float
    bytes_per_megapixel: float

    def at(self, megapixels: float) -> Cost:
        return Cost(
            self.cpu_seconds + self.cpu_seconds_per_megapixel * megapixels,
            self.bytes + self.bytes_per_megapixel * megapixels,
        )


class _Start(Document):
    cpu_seconds: float


class _Shipped(Document):
    """The shipped table: costs by kind and maker."""

    machine: str
    measured_by: str
    start: _Start
    statics: _Line
    thumbnail: _Line
    costs: dict[ProductKind, dict[str, _Line]]


@cache
def _shipped() -> _Shipped:
    return _Shipped.model_validate_json(files("valerie.runs.forecasting").joinpath("costs.json").read_bytes())
