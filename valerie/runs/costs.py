"""What a product costs: CPU seconds and bytes, from recorded timings where there are any, else from a shipped table.

The shipped table (``costs.json``) was measured; it says on what. Costs grow linearly with pixels:
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
    """Where a cost comes from."""

    #: Products of this kind, engine or function, and resolution that this installation made.
    RECORDED = "recorded"
    #: The table that ships with the package, measured on another machine.
    SHIPPED = "shipped"
    #: The dearest of its kind in the shipped table: nothing is known of this engine or function.
    GUESSED = "guessed"


class CostKey(NamedTuple):
    """What costs are told apart by.

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
    """Of one product."""

    cpu_seconds: float
    bytes: float


class CostTable:
    """Costs by key.

    Args:
        recorded: means over what this installation made.
        few: the same where so few were made that the shipped table is believed sooner: the first product of a worker
            also pays for what is loaded then.
    """

    def __init__(
        self, recorded: Mapping[CostKey, Cost] | None = None, few: Mapping[CostKey, Cost] | None = None
    ) -> None:
        self._recorded, self._few = dict(recorded or {}), dict(few or {})

    def cost(self, key: CostKey) -> tuple[Cost, Basis]:
        """The cost of one product, and where it is known from."""
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
        """Of the truth of what cannot move, which the truths of one camera share."""
        return _at(_shipped()["statics"], width * height / 1e6)

    @property
    def start_seconds(self) -> float:
        """CPU seconds of a run on one machine beside its products: start of the system, workers, the asset, results."""
        return float(_shipped()["start"]["cpu_seconds"])

    @property
    def machine(self) -> str:
        """What the shipped table was measured on."""
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
