"""Freeing what nobody links: product rows, their objects, and objects that no row knows."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

from valerie.db import functions, products, runs
from valerie.db.engine import reading, writing
from valerie.errors import NotFound
from valerie.pipeline.base.context import Context
from valerie.storage.keys import FUNCTIONS, PRODUCTS, RUNS, parse_function_key, parse_product_key, product_key

_BATCH = 500
#: Kinds of products that are rows alone.
_WITHOUT_OBJECT = ("evaluation", "light")
#: An object may be stored before its row says so; younger ones without a row are left alone.
_GRACE = timedelta(hours=1)


@dataclass(frozen=True, slots=True)
class Freed:
    """What `collect` removed (or would remove)."""

    products: int
    objects: int
    bytes: int


def collect(context: Context, *, dry_run: bool = False) -> Freed:
    """Remove products that no run links to and objects that belong to nothing.

    Rows go first: a killed collector leaves objects that the next one finds, never rows without objects.
    """
    removed = 0
    while True:
        with writing(context.engine) as connection:
            batch = products.unlinked(connection, limit=10**9 if dry_run else _BATCH)
            if not dry_run:
                products.delete(connection, [digest for digest, _ in batch])
        removed += len(batch)
        if not dry_run:
            context.store.delete(product_key(kind, digest) for digest, kind in batch if kind not in _WITHOUT_OBJECT)
        # Once more after the last products: what they were stored over is free now.
        if dry_run or not batch:
            break
    objects = size = 0
    limit = datetime.now(UTC) - _GRACE
    orphans: list[str] = []
    batch_keys: dict[str, tuple[str, int]] = {}
    for info in context.store.list(PRODUCTS.rstrip("/")):
        parsed = parse_product_key(info.key)
        if parsed is None or info.modified > limit:
            continue
        batch_keys[parsed[1]] = (info.key, info.size)
        if len(batch_keys) >= _BATCH:
            orphans += _without_rows(context, batch_keys)
            batch_keys = {}
    orphans += _without_rows(context, batch_keys)
    for info in context.store.list(RUNS.rstrip("/")):
        if info.modified <= limit and not _run_exists(context, info.key.split("/")[1]):
            orphans.append(info.key)
    orphans += _unregistered(context, limit)
    for key in orphans:
        objects += 1
        size += context.store.head(key).size
        if not dry_run:
            context.store.delete(key)
    if not dry_run:
        context.store.remove_staging()
    return Freed(removed, objects, size)


def _without_rows(context: Context, keys: dict[str, tuple[str, int]]) -> list[str]:
    with reading(context.engine) as connection:
        known = products.known_digests(connection, keys)
    return [key for digest, (key, _) in keys.items() if digest not in known]


def _unregistered(context: Context, limit: datetime) -> list[str]:
    """Payloads that no registered function has, older than ``limit``."""
    stored = {}
    for info in context.store.list(FUNCTIONS.rstrip("/")):
        sha256 = parse_function_key(info.key)
        if sha256 is not None and info.modified <= limit:
            stored[info.key] = sha256
    with reading(context.engine) as connection:
        known = functions.known_payloads(connection, set(stored.values()))
    return [key for key, sha256 in stored.items() if sha256 not in known]


def _run_exists(context: Context, run_id: str) -> bool:
    with reading(context.engine) as connection:
        try:
            runs.get(connection, run_id)
        except NotFound:
            return False
    return True
