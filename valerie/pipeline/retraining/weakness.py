"""The region where a function of a run is weak, with everything for training against it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from valerie.analysis.findings.region import Region, region_of
from valerie.analysis.rows.frame_counts import ABSENT
from valerie.db.archives import reading_run
from valerie.db.functions import SHORT
from valerie.errors import Conflict, InvalidInput
from valerie.measures import TableRow
from valerie.perception.documents.function import FunctionDocument
from valerie.perception.shipped import FUNCTIONS
from valerie.perception.training.frame_folder import SEEDS
from valerie.perception.training.provenance import sites_seen
from valerie.pipeline.base.context import Context
from valerie.pipeline.base.resolved_runs import StoredRun, read_run
from valerie.pipeline.functions.references import pinned_network
from valerie.pipeline.reading.selection import evaluated_persons, function_index, run_where
from valerie.pipeline.retraining.weak_scenes import quantities, run_values
from valerie.runs.resolving.spec import ResolvedRun
from valerie.scene.assets.asset import PACKS, AssetArguments, is_generated, pack_settings, parse_reference

#: First site seed for functions whose training sites are unknown.
_UNSEEN_SEED: Final = 50_000


@dataclass(frozen=True, slots=True, eq=False)
class Weakness:
    """A selection of rows in which one function of a run is weak.

    Attributes:
        runs, function, where: the request.
        selected, evaluated: number of selected rows (persons in frames), and of all rows of the function with a person.
        region: region of the selected rows.
        asset, arguments: name and arguments of the runs' generated asset, without its seed.
        asset_seed: site seed of the runs; no training frame comes from it.
        document, file: document of the version that the runs pinned, and its weights.
    """

    runs: tuple[str, ...]
    function: str
    where: str
    selected: int
    evaluated: int
    region: Region
    asset: str
    arguments: AssetArguments
    asset_seed: int
    document: FunctionDocument
    file: Path

    def first_seed(self) -> int:
        """Return the first site seed that neither the function's training nor the run used."""
        first = max((seeds[-1] for seeds in sites_seen(self.document.provenance)), default=_UNSEEN_SEED - 1) + 1
        return max(first, self.asset_seed + 1) if self.asset_seed in SEEDS["train"] else first

    @property
    def reference(self) -> str:
        """Reference, for specs, of exactly the version that the run pinned."""
        name = self.function.partition("@")[0]
        return name if name in FUNCTIONS else f"{name}@{self.document.digest[:SHORT]}"

    @property
    def next_name(self) -> str:
        """Default name of the next version; names of functions that ship with VALERIE are reserved."""
        name = self.function.partition("@")[0]
        return f"{name}-retrained" if name in FUNCTIONS else name


def find_weakness(
    context: Context, run_id: str, where: str, function: str | None = None, *, further: Sequence[str] = ()
) -> Weakness:
    """Return the weakness of a function of a run in a selection of its rows.

    Args:
        context: context of the deployment.
        run_id: id of a run on a generated asset that takes a seed.
        where: expression that selects rows: ``pacc < 0.5 and distance_m > 25``.
        function: one of the run's functions; None if it has only one.
        further: ids of runs of the same spec but for the variants; their rows count, too.

    Raises:
        NotFound: no such run, or the version that it pinned was removed.
        InvalidInput, UnknownName: the expression, the function or the asset is not suitable, or nothing is selected.
        Conflict: the installed weights of the function are not those that the run pinned, or a further run pinned others.
    """
    runs = [read_run(context, each) for each in (run_id, *further)]
    run = runs[0]
    name = _function(run.resolved, function)
    asset, arguments, seed = _generated(run.resolved)
    for other in runs[1:]:
        if (other.resolved.asset_digest, other.pins.functions.get(name)) != (
            run.resolved.asset_digest,
            run.pins.functions[name],
        ):
            raise Conflict(f"run {other.id} has another asset, or another version of {name}, than run {run_id}")
    region, evaluated = _region(context, runs, where, name)
    document, file = pinned_network(name, run.pins.functions[name], context=context)
    return Weakness(
        runs=(run_id, *further),
        function=name,
        where=where,
        selected=region.rows,
        evaluated=evaluated,
        region=region,
        asset=asset,
        arguments=arguments,
        asset_seed=seed,
        document=document,
        file=file,
    )


def selected_region(context: Context, run_id: str, where: str, function: str) -> Region | None:
    """Return the region of a selection of one function's rows; None if the run did not evaluate the function.

    Raises:
        NotFound: no such run.
        InvalidInput, UnknownName: the expression is wrong, or selects nothing.
    """
    run = read_run(context, run_id)
    return _region(context, [run], where, function)[0] if function in run.resolved.spec.functions else None


def functions_of(context: Context, run_id: str) -> tuple[str, ...]:
    """Return the names of a run's functions in its spec.

    Raises:
        NotFound: no such run.
    """
    return tuple(read_run(context, run_id).resolved.spec.functions)


def _region(context: Context, runs: Sequence[StoredRun], where: str, function: str) -> tuple[Region, int]:
    """Return the region of the selected rows, and the number of persons that the function was evaluated on."""
    resolved = runs[0].resolved
    inside: list[TableRow] = []
    everything: list[TableRow] = []
    for run in runs:
        condition = run_where(where, run.resolved)
        index = function_index(function, run.resolved)
        with reading_run(context.engine, run.id) as connection:
            for person in evaluated_persons(connection, run, function=index):
                if person.row["undefined_reason"] == ABSENT:
                    continue
                everything.append(run_values(person.instance_id, person.row, run.resolved))
                if condition.holds(person.row):
                    inside.append(everything[-1])
    if not inside:
        raise InvalidInput(f"selects none of {len(everything)} rows of {function}", field="where", value=where)
    return region_of(inside, everything, quantities(resolved)), len(everything)


def _function(resolved: ResolvedRun, function: str | None) -> str:
    functions = resolved.spec.functions
    if function is None and len(functions) != 1:
        raise InvalidInput("the run has several functions", field="--function", limit=", ".join(functions))
    return functions[function_index(function, resolved)]


def _generated(resolved: ResolvedRun) -> tuple[str, AssetArguments, int]:
    """Return name, other arguments and seed of the run's asset."""
    name, arguments = parse_reference(resolved.spec.asset)
    seed = getattr(pack_settings(name, arguments), "seed", None) if is_generated(name) else None
    if seed is None:
        raise InvalidInput(
            "new frames need fresh sites: an asset that is generated from a seed",
            field="asset",
            value=name,
            limit=", ".join(PACKS.names()),
        )
    return name, {argument: value for argument, value in arguments.items() if argument != "seed"}, seed
