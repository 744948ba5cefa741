"""Stored runs with their specs resolved, and the assets of the last few."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

from cachetools import LRUCache

from valerie.db import runs
from valerie.db.engine import reading
from valerie.pipeline.base.context import Context
from valerie.pipeline.base.resolved_runs import resolve_stored
from valerie.runs.spec import ResolvedRun
from valerie.scene.assets.asset import SceneAsset, load_asset

_KEPT_RUNS: Final = 16
_KEPT_ASSETS: Final = 2


@dataclass(frozen=True, slots=True)
class StoredRun:
    """A run, its spec resolved.

    Attributes:
        id: of the run.
        resolved: its spec, against the asset that it names.
        pins: the numeric classes that the run pinned (`valerie.pipeline.base.pins`); empty before it starts.
    """

    id: str
    resolved: ResolvedRun
    pins: dict[str, Any]


def read_run(context: Context, run_id: str) -> StoredRun:
    """Read a run and resolve its spec.

    Raises:
        NotFound: no such run.
        Conflict, UnknownName: its asset changed or is gone.
    """
    with reading(context.engine) as connection:
        row = runs.get(connection, run_id)
    return StoredRun(run_id, resolve_stored(row, context.settings), row.pins or {})


class RunCache:
    """The last few runs and assets that a process worked for; bounded, so that memory stays flat."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._runs: LRUCache[str, StoredRun] = LRUCache(_KEPT_RUNS)
        self._assets: LRUCache[str, SceneAsset] = LRUCache(_KEPT_ASSETS)

    def run(self, run_id: str) -> StoredRun:
        """Return a run.

        Raises:
            NotFound: it was deleted meanwhile.
            Conflict, UnknownName: its asset changed or is gone.
        """
        if run_id not in self._runs:
            self._runs[run_id] = read_run(self._context, run_id)
        return self._runs[run_id]

    def asset(self, run: StoredRun) -> SceneAsset:
        """Return the asset of a run, with its meshes."""
        digest = run.resolved.asset_digest
        if digest not in self._assets:
            self._assets[digest] = load_asset(run.resolved.spec.asset, asset_dir=self._context.settings.asset_dir)
        return self._assets[digest]
