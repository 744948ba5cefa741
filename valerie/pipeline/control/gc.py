"""Remove what nothing links to: product rows, their objects, and objects without a row."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

from valerie.db import functions, retention, runs, sweeping, totals
from valerie.db.archives import read_archived_digests
from valerie.db.engine import reading, writing
from valerie.errors import StorageFull
from valerie.pipeline.base.context import Context
from valerie.storage.keys import (
    FUNCTIONS,
    PRODUCTS,
    RUNS,
    archive_key,
    is_archive_key,
    parse_function_key,
    parse_product_key,
    product_key,
)

_BATCH = 500
#: An object is stored before its row says so; younger objects without a row are left untouched.
_GRACE = timedelta(hours=1)


@dataclass(frozen=True, slots=True)
class Freed:
    """Numbers of products, objects and bytes that `collect` removed, or would remove."""

    products: int
    objects: int
    bytes: int


def collect(context: Context, *, dry_run: bool = False, now: datetime | None = None) -> Freed:
    """Remove products that no run links to, pictures that no run keeps, and objects that belong to nothing.

    Rows are changed first: a killed collector leaves objects that the next one finds, never finished rows without objects.

    Args:
        context: context of the deployment.
        dry_run: remove nothing.
        now: reference time for the age of objects (default: that of the store at the call).
    """
    read_archived_digests(context.engine)
    removed = 0
    while True:
        with writing(context.engine) as connection:
            batch = sweeping.unlinked(connection, limit=10**9 if dry_run else _BATCH)
            if not dry_run:
                sweeping.free(connection, [product.digest for product in batch])
        removed += len(batch)
        if not dry_run:
            delete_unwanted(context, [product_key(kind, digest) for digest, kind in batch if kind.has_object])
        # One more round after the last products, since the statics under them have no links now.
        if dry_run or not batch:
            break
    with reading(context.engine) as connection:
        unkept = retention.unkept(connection)
    if dry_run:
        removed = len({*batch, *unkept})
    else:
        removed += _remove_unkept(context, [product.digest for product in unkept])
    objects = size = 0
    limit = (now or _store_time(context)) - _GRACE
    orphans: list[str] = []
    keys: dict[str, str] = {}
    for info in context.store.list(PRODUCTS.rstrip("/")):
        place = parse_product_key(info.key)
        if place is None or info.modified > limit:
            continue
        keys[place[1]] = info.key
        if len(keys) >= _BATCH:
            orphans += _unwanted(context, keys)
            keys = {}
    orphans += _unwanted(context, keys)
    for info in context.store.list(RUNS.rstrip("/")):
        if info.modified <= limit and not _of_a_run(context, info.key):
            orphans.append(info.key)
    orphans += _unregistered(context, limit)
    for key in orphans:
        objects += 1
        size += context.store.head(key).size
    if not dry_run:
        for start in range(0, len(orphans), _BATCH):
            delete_unwanted(context, orphans[start : start + _BATCH])
        context.store.remove_staging(before=limit)
    return Freed(removed, objects, size)


def _remove_unkept(context: Context, digests: Sequence[str]) -> int:
    """Remove the pictures whose last keeper was deleted (`valerie.pipeline.work.retention`); return their number."""
    removed = 0
    for start in range(0, len(digests), _BATCH):
        with writing(context.engine) as connection:
            parked = retention.park_still_unkept(connection, digests[start : start + _BATCH])
        delete_unwanted(context, [product_key(kind, digest) for digest, kind in parked])
        removed += len(parked)
    return removed


def delete_unwanted(context: Context, keys: Sequence[str]) -> None:
    """Delete objects, but those of products that a run has linked meanwhile."""
    places = {key: place[1] for key in keys if (place := parse_product_key(key)) is not None}
    with writing(context.engine) as connection:
        sweeping.keep_from_being_linked(connection)
        wanted = totals.wanted_digests(connection, set(places.values()))
        context.store.delete(key for key in keys if places.get(key) not in wanted)


def _store_time(context: Context) -> datetime:
    """Return the time by the clock that dates the objects."""
    try:
        return context.store.now()
    except StorageFull:  # a full store needs its collector, and takes no probe
        return datetime.now(UTC)


def _unwanted(context: Context, keys: dict[str, str]) -> list[str]:
    """Return those keys, by digest, whose product has no row, or is parked."""
    with reading(context.engine) as connection:
        wanted = totals.wanted_digests(connection, keys)
    return [key for digest, key in keys.items() if digest not in wanted]


def _unregistered(context: Context, limit: datetime) -> list[str]:
    """Return the keys of payloads older than ``limit`` that no registered function has."""
    stored = {}
    for info in context.store.list(FUNCTIONS.rstrip("/")):
        sha256 = parse_function_key(info.key)
        if sha256 is not None and info.modified <= limit:
            stored[info.key] = sha256
    with reading(context.engine) as connection:
        known = functions.known_payloads(connection, set(stored.values()))
    return [key for key, sha256 in stored.items() if sha256 not in known]


def _of_a_run(context: Context, key: str) -> bool:
    """Return True if the run of an artifact exists, and reads the artifact if it is part of an archive."""
    run_id = key.split("/")[1]
    with reading(context.engine) as connection:
        run = runs.find(connection, run_id)
    if run is None:
        return False
    tables = {} if run.archive is None else run.archive.tables
    return not is_archive_key(key) or key in {archive_key(run_id, name, file.sha256) for name, file in tables.items()}
