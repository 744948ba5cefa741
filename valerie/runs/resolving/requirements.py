"""The requirements of a run, ready to be judged."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from valerie.errors import InvalidInput
from valerie.measures import Row
from valerie.parameters.definitions import ParameterDefinition
from valerie.runs.document.run_spec import RequirementDocument, RunSpec
from valerie.runs.resolving.where import Where, choices_of, compile_where
from valerie.runs.statistic import Statistic, parse_statistic


@dataclass(frozen=True, slots=True)
class Requirement:
    """A requirement of a resolved run.

    Attributes:
        document: the requirement in the spec.
        statistic: the bounded statistic.
        where: its region; None: everything.
        functions: names of the functions that it applies to.
    """

    document: RequirementDocument
    statistic: Statistic
    where: Where | None
    functions: tuple[str, ...]

    def holds(self, row: Row) -> bool:
        """Return True if a row of results is in the region."""
        return self.where is None or self.where.holds(row)

    def excludes(self, row: Row) -> bool:
        """Return True if a row is outside the region for all possible missing values."""
        return self.where is not None and self.where.excludes(row)


def resolve_requirements(
    spec: RunSpec, definitions: Iterable[ParameterDefinition], cameras: Sequence[str], problems: list[InvalidInput]
) -> tuple[Requirement, ...]:
    """Return the requirements of a spec.

    Args:
        spec: spec with valid statistics.
        definitions: the run's parameters.
        cameras: the run's cameras.
        problems: receives every problem with a region, with its dotted field.
    """
    known, requirements = tuple(definitions), []
    for i, document in enumerate(spec.requirements):
        field = f"requirements.{i}"
        where = None
        try:
            if document.where:
                where = compile_where(document.where, known, choices=choices_of(spec, cameras), field=f"{field}.where")
        except InvalidInput as problem:
            problems.append(problem)
        statistic = parse_statistic(document.statistic, field=f"{field}.statistic")
        requirements.append(Requirement(document, statistic, where, document.functions or spec.functions))
    return tuple(requirements)
