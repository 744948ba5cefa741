"""Runs as a worker sees them: spec, manifest and asset, read once and kept while they are in use."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass
from typing import Any

from valerie.db import runs
from valerie.db.engine import reading
from valerie.pipeline.base.context import Context
from valerie.pipeline.base.resolved_runs import resolve_stored
from valerie.runs.spec import ResolvedRun
from valerie.scene.assets.asset import SceneAsset, load_asset

_KEPT_RUNS = 16
_KEPT_ASSETS = 2


@dataclass(frozen=True, slots=True)
class StoredRun:
    """What the row of a run says, resolved.

    Attributes:
        pins: the numeric classes that the run pinned (see `valerie.pipeline.base.pins`).
    """

    resolved: ResolvedRun
    pins: dict[str, Any]


class RunCache:
    """The last few runs and assets that this process worked for; bounded, so that memory stays flat."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._runs: OrderedDict[str, StoredRun] = OrderedDict()
        self._assets: OrderedDict[str, SceneAsset] = OrderedDict()

    def run(self, run_id: str) -> StoredRun:
        """The run with ``run_id``.

        Raises:
            NotFound: it was deleted meanwhile.
        """
        if run_id not in self._runs:
            with reading(self._context.engine) as connection:
                row = runs.get(connection, run_id)
            self._runs[run_id] = StoredRun(resolve_stored(row, self._context.settings), row.pins or {})
            while len(self._runs) > _KEPT_RUNS:
                self._runs.popitem(last=False)
        self._runs.move_to_end(run_id)
        return self._runs[run_id]

    def asset(self, run: StoredRun) -> SceneAsset:
        """The asset of a run, with its meshes."""
        digest = run.resolved.asset_digest
        if digest not in self._assets:
            self._assets[digest] = load_asset(run.resolved.spec.asset, asset_dir=self._context.settings.asset_dir)
            while len(self._assets) > _KEPT_ASSETS:
                self._assets.popitem(last=False)
        self._assets.move_to_end(digest)
        return self._assets[digest]
