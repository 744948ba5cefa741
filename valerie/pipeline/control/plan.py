"""What a spec would cost in this deployment: planned against what is stored already and what was measured so far."""

from __future__ import annotations

import time
from typing import Any, Final

from valerie.db import processes, products
from valerie.db.engine import reading
from valerie.pipeline.base.context import Context
from valerie.pipeline.base.pins import choose_pins
from valerie.pipeline.base.resolved_runs import resolve_new
from valerie.pipeline.functions import registry
from valerie.runs.costs import Cost, CostKey, CostTable
from valerie.runs.forecast import Plan, plan
from valerie.runs.spec import ResolvedRun, RunSpec
from valerie.runs.states import ProductKind


def plan_run(context: Context, spec: RunSpec) -> Plan:
    """Plan a spec; stores nothing.

    Raises:
        InvalidInput: an unknown name, a bound, a size: with field, value and limit.
    """
    with reading(context.engine) as connection:
        offers = processes.offers(connection, now=time.time())
        registered = registry.known(connection, spec.functions)
        names = registry.names(connection, registered)
        resolved = resolve_new(spec, context.settings, registered=names)
        pins, _ = choose_pins(spec.model_dump(mode="json"), offers, registered)
        recorded = products.recorded_costs(connection)

        def present(digests: set[str]) -> set[str]:
            return products.done_digests(connection, digests)

        return plan(resolved, pins=pins, present=present, costs=_costs(resolved, pins, recorded))


#: Products of which the mean is believed rather than the shipped table.
_MANY: Final = 3


def _costs(resolved: ResolvedRun, pins: dict[str, Any] | None, recorded: list[products.RecordedCost]) -> CostTable:
    """Recorded means at this run's resolution and with what it would pin, by the planner's keys."""
    if pins is None:
        return CostTable()
    resolution, spec = resolved.spec.resolution, resolved.spec
    pixels = resolution.width * resolution.height
    makers: dict[tuple[str, str], str] = {
        (ProductKind.TRUTH, pins["truth"]["route"]): "",
        **{(ProductKind(kind), pins["truth"]["route"]): "" for kind in resolved.annotations},
        (ProductKind.EVALUATION, "eval"): "",
    }
    if not resolved.engine_inputs:
        # Recorded costs do not tell settings apart.
        makers |= {(kind, pins["engine"]["route"]): spec.engine for kind in (ProductKind.BACKGROUND, ProductKind.LAYER)}
    by_digest = {pins["functions"][name]["digest"][:32]: name for name in spec.functions}
    costs: dict[CostKey, Cost] = {}
    few: dict[CostKey, Cost] = {}
    for row in recorded:
        maker = by_digest.get(row.group) if row.kind == ProductKind.PREDICTION else makers.get((row.kind, row.route))
        if maker is not None and row.pixels == pixels:
            key = CostKey(ProductKind(row.kind), maker, resolution.width, resolution.height)
            (costs if row.count >= _MANY else few)[key] = Cost(row.cpu_seconds, row.bytes)
    return CostTable(costs, few)
