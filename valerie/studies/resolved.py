"""Studies resolved against their asset: operational domain, specs of the runs, scores of the variants."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from valerie.errors import InvalidInput
from valerie.guided.domain import Domain
from valerie.measures import TableRow
from valerie.parameters.blocks import Variation
from valerie.parameters.samplers import UnitPoints
from valerie.runs.document.run_spec import BlockDocument, RunSpec
from valerie.runs.resolving.spec import ResolvedRun
from valerie.runs.resolving.where import Where, choices_of, compile_where
from valerie.runs.study.measure import VariantMeasure, parse_measure
from valerie.runs.study.study_document import CascadeGoal, Outcomes, StudyDocument
from valerie.runs.values import Scalar
from valerie.scene.assets.sensor_parameters import SENSOR_ROOT
from valerie.sensing.settings import RANDOM


@dataclass(frozen=True, slots=True)
class ResolvedStudy:
    """A study whose names are resolved.

    Attributes:
        document: the study.
        run: its spec, resolved.
        domain: its parameters and their distributions.
        measure: the score of a variant.
        where: expression that selects the rows that count; None: all.
    """

    document: StudyDocument
    run: ResolvedRun
    domain: Domain
    measure: VariantMeasure
    where: Where | None

    def rejection(self, point: UnitPoints) -> str | None:
        """Return the reason why the variant at a point, (dimensions,), is rejected; None for a legal one."""
        return self.run.rejection({**self.run.space.constants[0], **self.domain.values(point)})

    @property
    def renderers(self) -> tuple[str | dict[str, Scalar], ...]:
        """The render engine of the study, and the costly one where its goal has one."""
        goal, cheap = self.document.goal, self.document.spec.renderer
        return (cheap, goal.renderer) if isinstance(goal, CascadeGoal) else (cheap,)

    @property
    def is_random(self) -> bool:
        """True if pictures depend on the seed of a run: a sensor has a random effect, or may get one."""
        paths = {*self.run.space.constants[0], *(definition.path for definition in self.domain.definitions)}
        return any(setting.needs_seed for setting in self.document.spec.sensors) or any(
            path.removeprefix(f"{SENSOR_ROOT}.") in RANDOM for path in paths
        )

    def spec(self, points: UnitPoints, number: int, *, parent: str | None, seed: int, level: int = 0) -> RunSpec:
        """Return the spec of the run of a batch.

        Args:
            points: (n, dimensions) points of the batch.
            number: number of the batch, from 0.
            parent: id of the run of the previous batch.
            seed: seed of this run.
            level: 0 for the render engine of the study, 1 for the costly one of its goal.
        """
        return self.document.spec.model_copy(
            update={
                "name": f"{self.document.name}, batch {number + 1}",
                "blocks": (BlockDocument(design="points", points=tuple(self.domain.variants(points))),),
                "seed": seed,
                "parent_run": parent,
                "iteration": number,
                "renderer": self.renderers[level],
            }
        )

    def outcomes(self, rows: Iterable[TableRow], count: int, rejected: Sequence[int], cpu_seconds: float) -> Outcomes:
        """Return the outcomes of a batch.

        Args:
            rows: long table of its run, with the values of all parameters.
            count: number of variants.
            rejected: indices of the rejected ones.
            cpu_seconds: price of all products of its run.
        """
        values: dict[tuple[int, object], list[float]] = defaultdict(list)
        seen: set[tuple[object, ...]] = set()
        for row in rows:
            if self.where is not None and not self.where.holds(row):
                continue
            if not self.measure.statistic.of_persons:  # count each frame once, regardless of its number of persons
                frame = (row["frame_id"], row["sensor"], row["function"])
                if frame in seen:
                    continue
                seen.add(frame)
            value = row[self.measure.column]
            values[int(str(row["variant_index"])), row["function"]].append(np.nan if value is None else float(value))
        columns = []
        for function in self.document.spec.functions:
            scores = (self.measure.score(values.get((index, function), ())) for index in range(count))
            columns.append(tuple(None if np.isnan(score) else score for score in scores))
        return Outcomes(
            scores=columns[0],
            second=columns[1] if len(columns) > 1 else (),
            rejected=tuple(rejected),
            cpu_seconds=cpu_seconds if isinstance(self.document.goal, CascadeGoal) else None,
        )


def resolve_study(document: StudyDocument, run: ResolvedRun) -> ResolvedStudy:
    """Resolve the names of a study.

    Args:
        document: the study.
        run: its spec, resolved.

    Raises:
        InvalidInput, UnknownName: ``where`` or the goal names something that the asset does not have.
    """
    block = run.space.blocks[0]
    variations = [Variation(run.space.names[v.path].path, v.distribution) for v in block.variations]
    constants = run.space.constants[0]
    domain = Domain(
        run.definitions, variations, lambda variants: run.rejections([{**constants, **values} for values in variants])
    )
    where = None
    if document.where:
        where = compile_where(document.where, run.definitions, choices=choices_of(run.spec, run.cameras))
    resolved = ResolvedStudy(document, run, domain, parse_measure(document.measure), where)
    for name in ("failing", "passing"):
        values = getattr(document.goal, name, None)
        if values is None:
            continue
        try:
            reason = resolved.rejection(domain.point(values))
        except InvalidInput as problem:
            place = f"goal.{name}.{problem.field}"
            raise InvalidInput(problem.message, field=place, value=problem.value, limit=problem.limit) from None
        if reason is not None:
            raise InvalidInput(f"the variant is rejected: {reason}", field=f"goal.{name}", value=values)
    return resolved
