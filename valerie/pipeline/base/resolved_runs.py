"""Resolve specs against this deployment: new ones are checked in full, stored ones are trusted and kept.

A process keeps the last few runs that it worked for.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from typing import Final, NamedTuple

from cachetools import LRUCache

from valerie import plugins
from valerie.db import runs
from valerie.db.engine import reading
from valerie.db.runs import RunRow
from valerie.errors import Conflict
from valerie.pipeline.base.context import Context
from valerie.runs.pins import Pins
from valerie.runs.spec import ResolvedRun, RunSpec, resolve
from valerie.scene.assets.asset import asset_manifest
from valerie.settings import Settings


def resolve_new(spec: RunSpec, settings: Settings, *, registered: Collection[str] = ()) -> ResolvedRun:
    """Resolve the spec of a new run and check everything that it names.

    Args:
        spec: of the run.
        settings: of this deployment.
        registered: the registered functions of the spec (`valerie.pipeline.functions.registry.known`), and all other
            names that it might have meant.

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
    """A run that has started, resolved, with its pins."""

    resolved: ResolvedRun
    pins: Pins


def resolve_stored(run: RunRow, settings: Settings) -> ResolvedRun:
    """Resolve the spec of a stored run.

    Raises:
        Conflict, UnknownName: its asset changed or is gone.
    """
    with _lock:
        known = _runs.get(_key(run.id, settings))
    return _remember(run, settings) if known is None else known.resolved


def stored_run(context: Context, run_id: str) -> StoredRun:
    """Return a run that has started; its row is read only where this process does not know it.

    Raises:
        NotFound: no such run.
        Conflict, UnknownName: it has not started, or its asset changed or is gone.
    """
    with _lock:
        known = _runs.get(_key(run_id, context.settings))
    if known is not None and known.pins is not None:
        return StoredRun(known.resolved, known.pins)
    with reading(context.engine) as connection:
        run = runs.get(connection, run_id)
    return StoredRun(_remember(run, context.settings), run.pinned())


class _Known(NamedTuple):
    resolved: ResolvedRun
    pins: Pins | None


_Key = tuple[str, Path, str]
_runs: Final[LRUCache[_Key, _Known]] = LRUCache(maxsize=32)
_lock: Final = Lock()


def _key(run_id: str, settings: Settings) -> _Key:
    return (settings.database_url, settings.asset_dir, run_id)


def _remember(run: RunRow, settings: Settings) -> ResolvedRun:
    manifest, digest = asset_manifest(run.spec.asset, asset_dir=settings.asset_dir)
    if digest != run.asset_digest:
        raise Conflict(
            f"the asset {manifest.name!r} changed since run {run.id} was submitted "
            f"({run.asset_digest[:8]} → {digest[:8]}): submit the spec again"
        )
    resolved = resolve(run.spec, manifest, asset_digest=digest, max_variants=None, samplers=plugins.samplers())
    with _lock:
        _runs[_key(run.id, settings)] = _Known(resolved, run.pins)
    return resolved
