"""Resolve specs against this deployment: new ones are checked in full, stored ones are trusted and cached."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from typing import Final

from cachetools import LRUCache

from valerie import plugins
from valerie.db import runs
from valerie.db.engine import reading
from valerie.db.runs import RunRow
from valerie.errors import Conflict
from valerie.pipeline.base.context import Context
from valerie.runs.products.pins import Pins
from valerie.runs.resolving.spec import ResolvedRun, RunSpec, resolve
from valerie.scene.assets.asset import asset_manifest
from valerie.settings import Settings


def resolve_new(spec: RunSpec, settings: Settings, *, registered: Collection[str] = ()) -> ResolvedRun:
    """Resolve the spec of a new run and check everything that it names.

    Args:
        spec: spec of the run.
        settings: settings of this deployment.
        registered: the registered functions of the spec (`valerie.pipeline.functions.registry.known`), and all other
            names for suggestions.

    Raises:
        InvalidInput: an unknown name, a bound, a size: with field, value and limit.
    """
    manifest, digest = asset_manifest(spec.asset, asset_dir=settings.asset_dir)
    return resolve(
        spec,
        manifest,
        asset_digest=digest,
        engines=plugins.renderer_names(testing=settings.testing_engines),
        functions=(*plugins.function_names(testing=settings.testing_engines), *registered),
        max_variants=settings.max_variants,
        samplers=plugins.samplers(),
    )


@dataclass(frozen=True, slots=True)
class StoredRun:
    """A stored run with its resolved spec.

    Attributes:
        id: id of the run.
        resolved: its spec, resolved against its asset.
        chosen: its pins; None before it starts.
    """

    id: str
    resolved: ResolvedRun
    chosen: Pins | None

    @property
    def pins(self) -> Pins:
        """The pins of a run that has started.

        Raises:
            Conflict: it has not.
        """
        if self.chosen is None:
            raise Conflict(f"run {self.id} has not started yet")
        return self.chosen


def resolve_stored(run: RunRow, settings: Settings) -> StoredRun:
    """Resolve the spec of a stored run.

    Raises:
        Conflict, UnknownName: its asset changed or is gone.
    """
    entry = _known(run.id, settings)
    stored = StoredRun(run.id, _resolve(run, settings) if entry is None else entry.resolved, run.pins)
    with _lock:
        _runs[_key(run.id, settings)] = stored
    return stored


def read_run(context: Context, run_id: str) -> StoredRun:
    """Read a run and resolve its spec.

    Raises:
        NotFound: no such run.
        Conflict, UnknownName: its asset changed or is gone.
    """
    with reading(context.engine) as connection:
        run = runs.get(connection, run_id)
    return resolve_stored(run, context.settings)


def started_run(context: Context, run_id: str) -> StoredRun:
    """Return a run that has started, from this process's cache if possible; errors as in `read_run`."""
    entry = _known(run_id, context.settings)
    return read_run(context, run_id) if entry is None or entry.chosen is None else entry


_Key = tuple[str, Path, str]
_runs: Final[LRUCache[_Key, StoredRun]] = LRUCache(maxsize=32)
_lock: Final = Lock()


def _key(run_id: str, settings: Settings) -> _Key:
    return (settings.database_url, settings.asset_dir, run_id)


def _known(run_id: str, settings: Settings) -> StoredRun | None:
    with _lock:
        return _runs.get(_key(run_id, settings))


def _resolve(run: RunRow, settings: Settings) -> ResolvedRun:
    manifest, digest = asset_manifest(run.spec.asset, asset_dir=settings.asset_dir)
    if digest != run.asset_digest:
        raise Conflict(
            f"the asset {manifest.name!r} changed since run {run.id} was submitted "
            f"({run.asset_digest[:8]} → {digest[:8]}): submit the spec again"
        )
    return resolve(run.spec, manifest, asset_digest=digest, max_variants=None, samplers=plugins.samplers())
