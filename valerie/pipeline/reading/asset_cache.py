"""Cache of the last few assets of a process, with their meshes."""

from __future__ import annotations

from typing import Final

from cachetools import LRUCache

from valerie.pipeline.base.resolved_runs import StoredRun
from valerie.scene.assets.asset import SceneAsset, load_asset
from valerie.settings import Settings

_KEPT: Final = 2


class AssetCache:
    """The assets of runs; bounded, so that memory does not grow."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._assets: LRUCache[str, SceneAsset] = LRUCache(_KEPT)

    def of(self, run: StoredRun) -> SceneAsset:
        """Return the asset of a run."""
        digest = run.resolved.asset_digest
        if digest not in self._assets:
            self._assets[digest] = load_asset(run.resolved.spec.asset, asset_dir=self._settings.asset_dir)
        return self._assets[digest]
