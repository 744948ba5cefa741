"""Specs against what this deployment has: checked in full when they are new, trusted when they come from the database."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Collection
from pathlib import Path
from typing import Any

from valerie import plugins
from valerie.errors import Conflict
from valerie.runs.spec import ResolvedRun, RunSpec, resolve
from valerie.scene.assets.asset import asset_manifest
from valerie.settings import Settings

_KEPT = 32
_stored: OrderedDict[tuple[str, str, Path], ResolvedRun] = OrderedDict()


def resolve_new(spec: RunSpec, settings: Settings, *, registered: Collection[str] = ()) -> ResolvedRun:
    """Check everything that a new run names.

    Args:
        spec: what was asked for.
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


def resolve_stored(run: Any, settings: Settings) -> ResolvedRun:
    """Resolve the spec of a stored run (a row); the last few are kept.

    Raises:
        Conflict, UnknownName: its asset changed or is gone.
    """
    key = (run.id, run.spec_digest, settings.asset_dir)
    if key not in _stored:
        spec = RunSpec.model_validate(run.spec)
        manifest, digest = asset_manifest(spec.asset, asset_dir=settings.asset_dir)
        if digest != run.asset_digest:
            raise Conflict(
                f"the asset {manifest.name!r} changed since run {run.id} was submitted "
                f"({run.asset_digest[:8]} → {digest[:8]}): submit the spec again"
            )
        _stored[key] = resolve(spec, manifest, asset_digest=digest, max_variants=None, samplers=plugins.samplers())
        while len(_stored) > _KEPT:
            _stored.popitem(last=False)
    _stored.move_to_end(key)
    return _stored[key]
