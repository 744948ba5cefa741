"""From a spec to rows: variants, frames, evaluations and the products that they link to, one block per transaction."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from typing import Any, Final, NamedTuple

import orjson
from sqlalchemy import Engine

from valerie.broker import EVAL_QUEUE
from valerie.db import products, runs
from valerie.db.bulk import insert_rows
from valerie.db.engine import writing
from valerie.db.models import Evaluation, Frame, FrameAnnotation, Variant
from valerie.db.products import UPLOADED_GROUP, Ready, Wanted
from valerie.pipeline.base.resolved_runs import resolve_stored
from valerie.runs.inputs import ProductInputs
from valerie.runs.states import UPLOADED_ROUTE
from valerie.settings import Settings

#: A block ends with the variant that brings it to so many products, or at so many variants (they may all be rejected): small
#: enough for a short transaction, large enough to spread its cost, since digests are spread over all pages of an index.
BLOCK_PRODUCTS: Final = 4_000
BLOCK_VARIANTS: Final = 1_000


class Fed(NamedTuple):
    """What became of a block.

    Attributes:
        next_index: where the next block begins.
        products: how many the block links to; 0 where nothing was written.
        ready: those that became ready.
    """

    next_index: int
    products: int
    ready: list[Ready]


class Feeder:
    """Writes the rows of one run, block after block; deterministic, so a killed feeder's successor writes the same."""

    def __init__(self, run: Any, settings: Settings) -> None:
        self._run_id: str = run.id
        self._count: int = run.variant_count
        resolved = resolve_stored(run, settings)
        self._resolved = resolved
        self._inputs = ProductInputs(resolved, asset_digest=run.asset_digest, pins=run.pins)
        self._pins: dict[str, Any] = run.pins

    def feed(self, engine: Engine, first: int, now: float) -> Fed:
        """Write the block that begins at variant ``first``, unless somebody else did, or the run was stopped."""
        rows = self._rows(first)
        following = first + len(rows.variants)
        with writing(engine) as connection:
            run = runs.get(connection, self._run_id)
            if run.next_index != first or run.state != "running":
                return Fed(run.next_index, 0, [])  # another process was faster, or the run was stopped
            insert_rows(connection, Variant, _VARIANT, rows.variants)
            ready = products.want(connection, rows.wanted.values(), now)
            insert_rows(connection, Frame, _FRAME, rows.frames)
            insert_rows(connection, FrameAnnotation, _ANNOTATION, rows.annotations)
            insert_rows(connection, Evaluation, _EVALUATION, rows.evaluations)
            runs.open_block(connection, self._run_id, first, following - 1)
            rejected = run.rejected_count + rows.rejected
            runs.set_values(connection, self._run_id, next_index=following, rejected_count=rejected)
        return Fed(following, len(rows.wanted), ready)

    def _rows(self, first: int) -> _Rows:
        run_id, resolved = self._run_id, self._resolved
        places = [(t, c) for t in range(len(resolved.times.elapsed)) for c in range(len(resolved.cameras))]
        engine_route, truth_route = self._pins["engine"]["route"], self._pins["truth"]["route"]
        functions = [self._pins["functions"][name] for name in resolved.spec.functions]
        # (route and cache group of predictions, cache group of evaluations)
        targets = [
            (one["route"], one["digest"][:32], UPLOADED_GROUP if one["route"] == UPLOADED_ROUTE else "")
            for one in functions
        ]
        rows = _Rows()
        want = rows.wanted.setdefault
        last = min(first + BLOCK_VARIANTS, self._count)
        for index, (block, assignment) in enumerate(resolved.space.values(first, last), start=first):
            if len(rows.wanted) >= BLOCK_PRODUCTS:
                break
            reason = resolved.rejection(assignment)
            rows.variants.append((run_id, index, block, orjson.dumps(assignment).decode(), reason))
            if reason is not None:
                rows.rejected += 1
                continue
            for time, camera in places:
                moment = resolved.at(assignment, time)
                frame = self._inputs.frame(moment, camera, near=partial(resolved.near, assignment, time))
                background, layer, truth = frame.products.required
                want(background, (background, "background", engine_route, background, None, None, None))
                want(layer, (layer, "layer", engine_route, background, None, None, None))
                want(truth, (truth, "truth", truth_route, background, None, None, None))
                rows.frames.append((run_id, index, camera, time, background, layer, truth))
                for kind, product, inputs in frame.annotations:
                    needed = (*inputs, None, None, None)[:3]
                    want(product, (product, kind.value, truth_route, background, *needed))
                    rows.annotations.append((run_id, index, camera, time, kind.value, product))
                for sensor, function, prediction, scores, third, distorted in frame.evaluations:
                    route, group, counted = targets[function]
                    want(prediction, (prediction, "prediction", route, group, layer, background, third))
                    want(scores, (scores, "evaluation", EVAL_QUEUE, counted, prediction, truth, None))
                    rows.evaluations.append(
                        (run_id, index, camera, time, sensor, function, prediction, scores, distorted)
                    )
        return rows


@dataclass(slots=True)
class _Rows:
    """What a block writes, as tuples in the order of the columns below; ``wanted`` holds each product once."""

    variants: list[tuple[Any, ...]] = field(default_factory=list)
    frames: list[tuple[Any, ...]] = field(default_factory=list)
    annotations: list[tuple[Any, ...]] = field(default_factory=list)
    evaluations: list[tuple[Any, ...]] = field(default_factory=list)
    wanted: dict[str, Wanted] = field(default_factory=dict)
    rejected: int = 0


_VARIANT: Final = ("run_id", "index", "block", "assignment", "rejection")
_KEY: Final = ("run_id", "variant_index", "camera_index", "time_index")
_FRAME: Final = (*_KEY, "background", "layer", "truth")
_ANNOTATION: Final = (*_KEY, "kind", "product")
_EVALUATION: Final = (*_KEY, "sensor_index", "function_index", "prediction", "scores", "distorted")
