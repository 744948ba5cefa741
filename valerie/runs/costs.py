"""The cost of a product in CPU seconds and bytes: recorded here, or else from a table that ships with the package.

The shipped table (``costs.json``) was measured and names the machine. Costs grow linearly with the number of pixels:
``fixed + per_megapixel · megapixels``.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from enum import StrEnum
from functools import cache
from importlib.resources import files
from typing import Any, NamedTuple

from valerie.runs.states import ProductKind


class Basis(StrEnum):
    """The source of a cost."""

    #: Products of the same kind, maker and resolution that this installation made.
    RECORDED = "recorded"
    #: The table that ships with the package, measured on another machine.
    SHIPPED = "shipped"
    #: The most expensive entry of its kind in the shipped table, for an engine or function without an entry.
    GUESSED = "guessed"


class CostKey(NamedTuple):
    """The properties of a product that its cost depends on.

    Attributes:
        kind: of the product.
        maker: engine of backgrounds and layers, function of predictions; empty for truth and evaluation.
        width, height: pixels.
    """

    kind: ProductKind
    maker: str
    width: int
    height: int


class Cost(NamedTuple):
    """The cost of one product."""

    cpu_seconds: float
    bytes: float


class CostTable:
    """Costs by key.

    Args:
        recorded: means over the products that this installation made.
        few: means over so few products that the shipped table takes precedence, since the first product of a worker
            includes loading.
    """

    def __init__(
        self, recorded: Mapping[CostKey, Cost] | None = None, few: Mapping[CostKey, Cost] | None = None
    ) -> None:
        self._recorded, self._few = dict(recorded or {}), dict(few or {})

    def cost(self, key: CostKey) -> tuple[Cost, Basis]:
        """Return the cost of one product and its source."""
        if key in self._recorded:
            return self._recorded[key], Basis.RECORDED
        megapixels = key.width * key.height / 1e6
        makers = _shipped()["costs"][key.kind.value]
        if key.maker in makers:
            return _at(makers[key.maker], megapixels), Basis.SHIPPED
        if key in self._few:
            return self._few[key], Basis.RECORDED
        return max(_at(entry, megapixels) for entry in makers.values()), Basis.GUESSED

    def statics(self, width: int, height: int) -> Cost:
        """Return the cost of the truth of the statics, which the truths of one camera share."""
        return _at(_shipped()["statics"], width * height / 1e6)

    @property
    def start_seconds(self) -> float:
        """CPU seconds of a run on one machine besides its products: to start, to load the asset, to write results."""
        return float(_shipped()["start"]["cpu_seconds"])

    @property
    def machine(self) -> str:
        """The machine that the shipped table was measured on."""
        return str(_shipped()["machine"])


def _at(entry: Mapping[str, float], megapixels: float) -> Cost:
    return Cost(
        entry["cpu_seconds"] + entry["cpu_seconds_per_megapixel"] * megapixels,
        entry["bytes"] + entry["bytes_per_megapixel"] * megapixels,
    )


@cache
def _shipped() -> dict[str, Any]:
    document: dict[str, Any] = json.loads(files("valerie.runs").joinpath("costs.json").read_text("utf-8"))
    return document
