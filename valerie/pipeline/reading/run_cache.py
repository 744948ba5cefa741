"""Runs as a worker sees them: spec, pins and asset, read once and kept while they are in use."""

from __future__ import annotations

from cachetools import LRUCache

from valerie.pipeline.base.context import Context
from valerie.pipeline.base.resolved_runs import StoredRun, stored_run
from valerie.scene.assets.asset import SceneAsset, load_asset


class RunCache:
    """The runs that this process works for, and the last few assets with their meshes."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._assets: LRUCache[str, SceneAsset] = LRUCache(maxsize=2)

    def run(self, run_id: str) -> StoredRun:
        """Return a run; errors as `stored_run`."""
        return stored_run(self._context, run_id)

    def asset(self, run: StoredRun) -> SceneAsset:
        """Return the asset of a run, with its meshes."""
        digest = run.resolved.asset_digest
        asset = self._assets.get(digest)
        if asset is None:
            asset = load_asset(run.resolved.spec.asset, asset_dir=self._context.settings.asset_dir)
            self._assets[digest] = asset
        return asset
