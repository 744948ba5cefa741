"""The next spec from a run, refined where rows are selected, at a finding, or where a requirement is missed."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from valerie.analysis.findings.findings import Findings
from valerie.analysis.findings.refining import halved_spec
from valerie.analysis.findings.region import Region, region_of
from valerie.db.archives import reading_run
from valerie.errors import InvalidInput, UnknownName
from valerie.measures import TableRow
from valerie.parameters.definitions import ParameterDefinition, ParameterType, Value
from valerie.pipeline.base.context import Context
from valerie.pipeline.base.resolved_runs import StoredRun, read_run
from valerie.pipeline.base.run_artifacts import read_summary
from valerie.pipeline.reading.selection import evaluated_persons, run_where
from valerie.plain import typed


@dataclass(frozen=True, slots=True)
class RefinedPart:
    """The part of a run to refine. At most one field is set; none means everything."""

    where: str | None = None
    finding: int | None = None
    requirement: str | None = None


def refine_run(
    context: Context, run_id: str, selection: RefinedPart, *, add: Sequence[str] = (), drop: Sequence[str] = ()
) -> tuple[str, str]:
    """Return the next spec as YAML, and the region that it covers in words.

    Args:
        context: context of the deployment.
        run_id: id of a run with results.
        selection: the part to refine.
        add, drop: names or paths of parameters.

    Raises:
        NotFound: no such run.
        InvalidInput: several selections, an empty selection, or an unknown name.
    """
    if sum(part is not None for part in (selection.where, selection.finding, selection.requirement)) > 1:
        raise InvalidInput("name one region to refine", limit="--where, --finding or --requirement")
    run = read_run(context, run_id)
    if selection.finding is not None:
        if add or drop:
            raise InvalidInput(
                "cannot be combined with --add or --drop: a finding already names its parameters", field="--finding"
            )
        finding = typed(Findings, read_summary(context, run_id)["findings"]).numbered(selection.finding)
        return finding.spec, finding.sentence
    names = run.resolved.space.names
    paths = [[_path(names, name, field) for name in entries] for field, entries in (("--add", add), ("--drop", drop))]
    with reading_run(context.engine, run_id) as connection:
        rows = [person.row for person in evaluated_persons(connection, run)]
    if not rows:
        raise InvalidInput("the run has no evaluated person yet", field="RUN", value=run_id)
    selected = _selected(run, selection, rows)
    varied = run.resolved.space.varied
    kinds: dict[str, ParameterType] = {path: run.resolved.space.definitions[path].type for path in varied}
    some = Region() if selected is rows else region_of(selected, rows, kinds)
    middle = {path: _middle([row[path] for row in selected], kinds[path]) for path in varied if selected}  # type: ignore[misc]
    spec = halved_spec(
        run.resolved.spec,
        run.resolved.space.blocks,
        run.resolved.space.definitions,
        some,
        run_id=run_id,
        middle=middle,
        add=paths[0],
        drop=paths[1],
    )
    everything = "everything, since the selected rows vary as widely as the run"
    return spec.to_yaml(), "" if selected is rows else str(some) if some.bounds else everything


def _selected(run: StoredRun, selection: RefinedPart, rows: Sequence[TableRow]) -> Sequence[TableRow]:
    if selection.where is not None:
        condition = run_where(selection.where, run.resolved, field="--where")
        return [row for row in rows if condition.holds(row)]
    if selection.requirement is None:
        return rows
    known = {requirement.document.id: requirement for requirement in run.resolved.requirements}
    if selection.requirement not in known:
        raise UnknownName("requirement", selection.requirement, known, field="--requirement")
    requirement = known[selection.requirement]
    statistic = requirement.statistic
    # For a share, the rows that miss its condition; for a mean, those below its bound.
    bound = 1.0 if statistic.condition is not None else statistic.at_least
    missing = []
    for row in rows:
        value = row[statistic.measure.name]
        if value is None or row["function"] not in requirement.functions or not requirement.holds(row):
            continue
        if statistic.scores(np.array([value], np.float64))[0] < bound:
            missing.append(row)
    if not missing:
        raise InvalidInput("no row misses the requirement", field="--requirement", value=selection.requirement)
    return missing


def _path(names: Mapping[str, ParameterDefinition], name: str, field: str) -> str:
    if name not in names:
        raise UnknownName("parameter", name, names, field=field)
    return names[name].path


def _middle(values: Sequence[Value], kind: ParameterType) -> Value:
    """Return the most frequent value, or the median of numbers."""
    if kind in (ParameterType.CATEGORICAL, ParameterType.BOOL):
        return Counter(values).most_common(1)[0][0]
    return sorted(values)[len(values) // 2]
