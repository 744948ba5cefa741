"""Plan a spec against this deployment, with its stored products and recorded costs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Final

from sqlalchemy import Connection

from valerie.db import processes, runs, totals
from valerie.db.engine import database_time, reading
from valerie.perception.documents.function import FunctionDocument
from valerie.perception.documents.training_data import has_seen
from valerie.perception.shipped import FUNCTIONS, function_document
from valerie.pipeline.base.context import Context
from valerie.pipeline.base.pinning import pins_for
from valerie.pipeline.base.resolved_runs import resolve_new
from valerie.pipeline.control import quotas
from valerie.pipeline.functions import registry
from valerie.runs.forecasting.costs import Cost, CostKey, CostTable
from valerie.runs.forecasting.forecast import EXACT_FRAMES, plan
from valerie.runs.forecasting.plan import Plan
from valerie.runs.products.pins import Pins, TolerantPins, numeric_classes
from valerie.runs.products.states import EVAL_QUEUE, ProductKind
from valerie.runs.resolving.spec import ResolvedRun, RunSpec
from valerie.scene.assets.asset import is_generated, pack_settings, parse_reference

#: Number of products from which their mean replaces the shipped table.
_MANY: Final = 3
#: Largest number of frames that a submission examines.
_FORECAST_FRAMES: Final = 4_000


def plan_run(
    context: Context,
    spec: RunSpec,
    *,
    owner: str | None = None,
    project: str = "",
    notes: tuple[str, ...] | None = None,
) -> Plan:
    """Plan a spec; stores nothing.

    Args:
        context: of the deployment.
        spec: of the run.
        owner: of the token that would submit it; None: the operator.
        project: that would submit it; only what its tenant shares counts as stored. Empty: none.
        notes: on what the user wrote, where that is not the spec; None: those of the spec.

    Raises:
        InvalidInput: an unknown name, a bound, a size: with field, value and limit.
    """
    with reading(context.engine) as connection:
        offers = processes.offers_by_worker(connection, now=database_time(connection))
        registered = registry.known(connection, spec.functions)
        names = registry.names(connection, registered)
        resolved = resolve_new(spec, context.settings, registered=names)
        if notes is not None:
            resolved = replace(resolved, notes=notes)
        pins = pins_for(connection, spec, offers, registered, lambda: resolved.space).pins
        twin = runs.latest_of(connection, resolved.spec.digest, project=project)
        made = _planned(connection, resolved, pins, context.settings.tenant_of(project), EXACT_FRAMES)
        refusals = quotas.refusals(
            connection, context.settings, made.variants, made.known_cost, owner=owner, project=project
        )
    shipped = {name: function_document(name) for name in spec.functions if name in FUNCTIONS}
    warnings = (*made.warnings, *_on_training_sites(spec, shipped | registered))
    if twin is not None:
        warnings += (f"run {twin} has this spec already, and another one has the same results",)
    warnings += tuple(f"it would be refused: {reason}" for reason in refusals)
    return made.model_copy(update={"warnings": warnings, "notes": (*made.notes, *_on_classes(pins))})


def forecast(connection: Connection, resolved: ResolvedRun, pins: Pins | None, tenant: str) -> Cost:
    """Estimate the cost of a run from a sample, within a second. Costs that are guesses are left out."""
    return _planned(connection, resolved, pins, tenant, _FORECAST_FRAMES).known_cost


def _planned(connection: Connection, resolved: ResolvedRun, pins: Pins | None, tenant: str, exact_frames: int) -> Plan:
    def present(digests: set[str]) -> set[str]:
        return totals.done_digests(connection, digests)

    costs = _costs(resolved, pins, totals.recorded_costs(connection))
    return plan(resolved, pins=pins, tenant=tenant, present=present, costs=costs, exact_frames=exact_frames)


def _on_classes(pins: Pins | None) -> Iterator[str]:
    """Yield a note on the numeric classes that a run with tolerance would pin."""
    if isinstance(pins, TolerantPins):
        yield "reproducible: tolerance: " + "; ".join(f"{part}: {text}" for part, text in numeric_classes(pins).items())


def _on_training_sites(spec: RunSpec, documents: Mapping[str, FunctionDocument]) -> Iterator[str]:
    """Yield a warning for each function that was trained on the site of the run."""
    asset, arguments = parse_reference(spec.asset)
    seed = getattr(pack_settings(asset, arguments), "seed", None) if is_generated(asset) else None
    site = asset if seed is None else f"site seed {seed} of {asset}"
    for name, document in documents.items():
        if has_seen(document, asset, seed):
            yield f"{name} was trained on {site}: its scores there say little about other places"


def _costs(resolved: ResolvedRun, pins: Pins | None, recorded: list[totals.RecordedCost]) -> CostTable:
    """Return recorded means at this run's resolution and with its pins, by the planner's keys."""
    if pins is None:
        return CostTable()
    resolution, spec = resolved.spec.resolution, resolved.spec
    pixels = resolution.width * resolution.height
    makers = {
        (ProductKind.TRUTH, pins.truth.route): "",
        **{(ProductKind(kind), pins.truth.route): "" for kind in resolved.annotations},
        (ProductKind.EVALUATION, EVAL_QUEUE): "",
    }
    if not resolved.engine_inputs:
        # Recorded costs do not distinguish settings.
        makers |= {(kind, pins.engine.route): spec.engine for kind in (ProductKind.BACKGROUND, ProductKind.LAYER)}
    by_digest = {pins.functions[name].digest[:32]: name for name in spec.functions}
    costs: dict[CostKey, Cost] = {}
    few: dict[CostKey, Cost] = {}
    for row in recorded:
        maker = by_digest.get(row.group) if row.kind is ProductKind.PREDICTION else makers.get((row.kind, row.route))
        if maker is not None and row.pixels == pixels:
            key = CostKey(row.kind, maker, resolution.width, resolution.height)
            (costs if row.count >= _MANY else few)[key] = Cost(row.cpu_seconds, row.bytes)
    return CostTable(costs, few)
