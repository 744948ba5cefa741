"""From a spec to rows: variants, frames, evaluations and the products that they link to, one block per transaction."""

from __future__ import annotations

from typing import Any, Final

from sqlalchemy import Engine

from valerie.db import products, runs
from valerie.db.engine import writing
from valerie.db.models import Block, Evaluation, Frame, Variant
from valerie.db.products import Ready
from valerie.pipeline.resolution import resolve_stored
from valerie.runs.inputs import ProductInputs
from valerie.scene.legality import rejection_reason
from valerie.settings import Settings

#: Variants per block: small enough for a short transaction, large enough to spread its cost.
BLOCK: Final = 250


class Feeder:
    """Writes the rows of one run, block after block; deterministic, so a killed feeder's successor writes the same."""

    def __init__(self, run: Any, settings: Settings) -> None:
        self._run_id: str = run.id
        self._count: int = run.variant_count
        resolved = resolve_stored(run, settings)
        self._resolved = resolved
        self._inputs = ProductInputs(resolved, asset_digest=run.asset_digest, pins=run.pins)
        self._pins: dict[str, Any] = run.pins

    def feed(self, engine: Engine, first: int, now: float) -> tuple[list[Ready], int]:
        """Write the block that begins at variant ``first``.

        Returns:
            what became ready, and how many products the block links to.
        """
        last = min(first + BLOCK, self._count) - 1
        variants, frames, evaluations, wanted = self._rows(first, last)
        rejected = sum(1 for variant in variants if variant["rejection"] is not None)
        with writing(engine) as connection:
            run = runs.get(connection, self._run_id)
            if run.next_index != first or run.state != "running":
                return [], 0  # another process was faster, or the run was stopped
            connection.execute(Variant.__table__.insert(), variants)  # type: ignore[attr-defined]
            products.insert_wanted(connection, list(wanted.values()))
            if frames:
                connection.execute(Frame.__table__.insert(), frames)  # type: ignore[attr-defined]
            if evaluations:
                connection.execute(Evaluation.__table__.insert(), evaluations)  # type: ignore[attr-defined]
            connection.execute(
                Block.__table__.insert(),  # type: ignore[attr-defined]
                {
                    "run_id": self._run_id,
                    "number": first // BLOCK,
                    "first": first,
                    "last": last,
                    "closed": False,
                    "counts": {},
                },
            )
            ready = products.promote(connection, wanted, now)
            runs.set_values(connection, self._run_id, next_index=last + 1, rejected_count=run.rejected_count + rejected)
        return ready, len(wanted)

    def _rows(
        self, first: int, last: int
    ) -> tuple[list[dict[str, Any]], list[dict[str, Any]], list[dict[str, Any]], dict[str, dict[str, Any]]]:
        manifest = self._resolved.manifest
        run_id = self._run_id
        variants: list[dict[str, Any]] = []
        frames: list[dict[str, Any]] = []
        evaluations: list[dict[str, Any]] = []
        wanted: dict[str, dict[str, Any]] = {}
        engine_route, truth_route = self._pins["engine"]["route"], self._pins["truth"]["route"]
        functions = [self._pins["functions"][name] for name in self._resolved.spec.functions]
        for index, (block, assignment) in enumerate(self._resolved.space.values(first, last + 1), start=first):
            reason = self._resolved.space.violated(assignment) or rejection_reason(assignment, manifest)
            variants.append(
                {"run_id": run_id, "index": index, "block": block, "assignment": assignment, "rejection": reason}
            )
            if reason is not None:
                continue
            for camera in range(len(self._resolved.cameras)):
                digests = self._inputs.frame(assignment, camera)
                background = digests.background
                _want(wanted, background, "background", engine_route, background)
                _want(wanted, digests.layer, "layer", engine_route, background)
                _want(wanted, digests.truth, "truth", truth_route, background)
                key = {"run_id": run_id, "variant_index": index, "camera_index": camera, "time_index": 0}
                frames.append({**key, "background": background, "layer": digests.layer, "truth": digests.truth})
                for evaluation in digests.evaluations:
                    function = functions[evaluation.function_index]
                    _want(
                        wanted,
                        evaluation.prediction,
                        "prediction",
                        function["route"],
                        function["digest"][:32],
                        digests.layer,
                        background,
                    )
                    _want(
                        wanted,
                        evaluation.scores,
                        "evaluation",
                        "eval",
                        "",
                        evaluation.prediction,
                        digests.truth,
                    )
                    evaluations.append(
                        {
                            **key,
                            "sensor_index": evaluation.sensor_index,
                            "function_index": evaluation.function_index,
                            "prediction": evaluation.prediction,
                            "scores": evaluation.scores,
                        }
                    )
        return variants, frames, evaluations, wanted


def _want(
    wanted: dict[str, dict[str, Any]],
    digest: str,
    kind: str,
    route: str,
    group: str,
    input_a: str | None = None,
    input_b: str | None = None,
) -> None:
    if digest not in wanted:
        wanted[digest] = {
            "digest": digest,
            "kind": kind,
            "state": "waiting",
            "route": route,
            "cache_group": group,
            "input_a": input_a,
            "input_b": input_b,
            "attempts": 0,
        }
