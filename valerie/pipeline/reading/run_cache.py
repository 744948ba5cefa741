"""Cache of a worker's runs with their assets."""

from __future__ import annotations

from typing import Final

from cachetools import LRUCache

from valerie.pipeline.base.context import Context
from valerie.pipeline.base.resolved_runs import StoredRun, started_run
from valerie.scene.assets.asset import SceneAsset, load_asset

_KEPT_ASSETS: Final = 2


class RunCache:
    """The runs of a process, and the last few assets; bounded, so that memory does not grow."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._assets: LRUCache[str, SceneAsset] = LRUCache(_KEPT_ASSETS)

    def run(self, run_id: str) -> StoredRun:
        """Return a run.

        Raises:
            NotFound: it was deleted.
            Conflict, UnknownName: its asset changed or is gone.
        """
        return started_run(self._context, run_id)

    def asset(self, run: StoredRun) -> SceneAsset:
        """Return the asset of a run, with its meshes."""
        digest = run.resolved.asset_digest
        if digest not in self._assets:
            self._assets[digest] = load_asset(run.resolved.spec.asset, asset_dir=self._context.settings.asset_dir)
        return self._assets[digest]
