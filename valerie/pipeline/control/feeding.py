"""Turn a spec into rows: variants, frames, evaluations and the products that they link to, one block per transaction."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import orjson
from sqlalchemy import Engine

from valerie.db import fed_blocks, products, runs
from valerie.db.engine import writing
from valerie.db.links import key_of
from valerie.db.models import Evaluation, Frame, FrameAnnotation, Variant
from valerie.db.products import Wanted
from valerie.db.runs import RunRow, RunValues
from valerie.db.statements import insert_rows
from valerie.db.totals import UPLOADED_GROUP
from valerie.pipeline.base.resolved_runs import resolve_stored
from valerie.runs.products.frame_keys import FrameKey
from valerie.runs.products.inputs import ProductInputs
from valerie.runs.products.pins import FunctionPin, Pins
from valerie.runs.products.ready import Ready
from valerie.runs.products.states import EVAL_QUEUE, UPLOADED_ROUTE, ProductKind, RunState
from valerie.runs.products.turns import Turns
from valerie.runs.resolving.spec import ResolvedRun
from valerie.settings import Settings

#: A block ends with the variant that brings it to this many products: small enough for a short transaction, large enough to
#: amortise its cost, since digests touch all pages of an index.
BLOCK_PRODUCTS: Final = 4_000
#: … or after this many variants, since all of them may be rejected.
BLOCK_VARIANTS: Final = 1_000


class WrittenBlock(NamedTuple):
    """A written block.

    Attributes:
        products: number of products that it links to; 0 if nothing was written.
        ready: products that became ready.
        frames: the frames that it has.
    """

    products: int
    ready: list[Ready]
    frames: Iterable[FrameKey]


class _Target(NamedTuple):
    """Route and cache group of a function's predictions, and the cache group of their evaluations."""

    route: str
    group: str
    scores_group: str

    @classmethod
    def of(cls, pin: FunctionPin) -> _Target:
        return cls(pin.route, pin.digest[:32], UPLOADED_GROUP if pin.route == UPLOADED_ROUTE else "")


class _Making(NamedTuple):
    """What the frames of some pins are made of, and where."""

    digests: ProductInputs
    engine_route: str
    truth_route: str
    targets: Sequence[_Target]

    @classmethod
    def of(cls, resolved: ResolvedRun, run: RunRow, pins: Pins) -> _Making:
        return cls(
            ProductInputs(resolved, asset_digest=run.asset_digest, pins=pins, tenant=run.tenant),
            pins.engine.route,
            pins.truth.route,
            [_Target.of(pins.functions[name]) for name in resolved.spec.functions],
        )


class Feeder:
    """Writes the rows of one run, block after block; deterministic, so the successor of a killed process writes the same.

    Raises:
        Conflict, UnknownName: the run's asset changed or is gone.
    """

    def __init__(self, run: RunRow, settings: Settings) -> None:
        self._run_id = run.id
        self._count = run.variant_count
        self._owner = run.owner or ""
        stored = resolve_stored(run, settings)
        self._resolved, self._pins = stored.resolved, stored.pins
        self._making = {
            id(pins): _Making.of(self._resolved, run, pins)  # which the run's pins keep
            for pins in self._pins.combinations()
        }

    def feed(self, engine: Engine, first: int, now: float, *, part: float = 1.0, weight: float = 1.0) -> WrittenBlock:
        """Write the block that begins at variant ``first``, unless another process did or the run was stopped.

        Args:
            engine: database.
            first: index of a variant.
            now: Unix seconds.
            part: fraction of a whole block: runs that are fed at the same time share it.
            weight: the run's share beside runs of weight 1 of the same owner.
        """
        rows = self._rows(first, part * BLOCK_PRODUCTS)
        following = first + len(rows.variants)
        with writing(engine) as connection:
            run = runs.fed(connection, self._run_id)
            if run.next_index != first or run.state is not RunState.RUNNING:
                return WrittenBlock(0, [], ())
            insert_rows(connection, Variant, _VariantRow, rows.variants)
            turns = Turns(run.turn, weight, owner=self._owner, present=products.present_turns(connection))
            ready = products.want(connection, rows.wanted.values(), now, turns)
            insert_rows(connection, Frame, _FrameRow, rows.frames)
            insert_rows(connection, FrameAnnotation, _AnnotationRow, rows.annotations)
            insert_rows(connection, Evaluation, _EvaluationRow, rows.evaluations)
            fed_blocks.open_block(connection, self._run_id, first, following - 1)
            rejected = run.rejected_count + rows.rejected
            changes: RunValues = {"next_index": following, "rejected_count": rejected, "turn": turns.following}
            runs.set_values(connection, self._run_id, **changes)
        # Most deployments write no traces, and never read them.
        frames = (key_of(row.run_id, row) for row in rows.frames)
        return WrittenBlock(len(rows.wanted), ready, frames)

    def _rows(self, first: int, limit: float) -> _BlockRows:
        run_id, resolved = self._run_id, self._resolved
        places = [(t, c) for t in range(len(resolved.times.elapsed)) for c in range(len(resolved.cameras))]
        rows = _BlockRows()
        want = rows.wanted.setdefault
        last = min(first + BLOCK_VARIANTS, self._count)
        for index, (block, assignment) in enumerate(resolved.space.values(first, last), start=first):
            if len(rows.wanted) >= limit:
                break
            reason = resolved.rejection(assignment)
            rows.variants.append(_VariantRow(run_id, index, block, orjson.dumps(assignment).decode(), reason))
            if reason is not None:
                rows.rejected += 1
                continue
            digests, engine_route, truth_route, targets = self._making[id(self._pins.at(assignment))]
            for time, camera in places:
                moment = resolved.at(assignment, time)
                frame = digests.frame(moment, camera, course=resolved.around(assignment, time))
                background, layer, truth = frame.products.required
                want(background, Wanted(background, ProductKind.BACKGROUND, engine_route, background))
                want(layer, Wanted(layer, ProductKind.LAYER, engine_route, background))
                want(truth, Wanted(truth, ProductKind.TRUTH, truth_route, background))
                rows.frames.append(_FrameRow(run_id, index, camera, time, background, layer, truth))
                for kind, product, inputs in frame.annotations:
                    route = engine_route if kind is ProductKind.SCAN else truth_route
                    want(product, Wanted(product, kind, route, background, *inputs))
                    rows.annotations.append(_AnnotationRow(run_id, index, camera, time, kind.value, product))
                for sensor, function, prediction, scores, third, distorted, empty in frame.evaluations:
                    route, group, scores_group = targets[function]
                    want(prediction, Wanted(prediction, ProductKind.PREDICTION, route, group, layer, background, third))
                    if empty is not None:
                        want(empty, Wanted(empty, ProductKind.PREDICTION, route, group, background))
                    parts = prediction, truth, empty
                    want(scores, Wanted(scores, ProductKind.EVALUATION, EVAL_QUEUE, scores_group, *parts))
                    place = run_id, index, camera, time, sensor, function
                    rows.evaluations.append(_EvaluationRow(*place, prediction, scores, distorted, empty))
        return rows


class _VariantRow(NamedTuple):
    """The columns of a variant; its assignment is JSON text."""

    run_id: str
    index: int  # type: ignore[assignment]  # a column, not tuple.index
    block: int
    assignment: str
    rejection: str | None


class _FrameRow(NamedTuple):
    """The columns of a frame."""

    run_id: str
    variant_index: int
    camera_index: int
    time_index: int
    background: str
    layer: str
    truth: str


class _AnnotationRow(NamedTuple):
    """The columns of a frame's annotation."""

    run_id: str
    variant_index: int
    camera_index: int
    time_index: int
    kind: str
    product: str


class _EvaluationRow(NamedTuple):
    """The columns of an evaluation."""

    run_id: str
    variant_index: int
    camera_index: int
    time_index: int
    sensor_index: int
    function_index: int
    prediction: str
    scores: str
    distorted: bool
    empty: str | None


@dataclass(slots=True)
class _BlockRows:
    """The rows of a block; ``wanted`` contains each product once, by digest."""

    variants: list[_VariantRow] = field(default_factory=list)
    frames: list[_FrameRow] = field(default_factory=list)
    annotations: list[_AnnotationRow] = field(default_factory=list)
    evaluations: list[_EvaluationRow] = field(default_factory=list)
    wanted: dict[str, Wanted] = field(default_factory=dict)
    rejected: int = 0
