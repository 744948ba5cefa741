"""The life of a product in a worker: claim → compute → store → publish → ring for what became ready.

No transaction is open while computing; a heartbeat thread renews the leases. Everything here may be killed at any moment:
what was stored but not published is stored again with equal bytes, what was claimed comes back when its lease ends.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Final, Protocol, runtime_checkable

import structlog

from valerie.db import products
from valerie.db.engine import writing
from valerie.db.products import Finished, Job
from valerie.errors import (
    MissingInput,
    StorageFull,
    StorageUnavailable,
    TransientError,
    ValerieError,
)
from valerie.pipeline.base.context import Context
from valerie.pipeline.base.pausing import pause_for_storage
from valerie.storage.keys import product_key

log = structlog.get_logger()

#: Finished products are published together at most this late: a killed worker loses no more work than that.
_PUBLISH_SECONDS: Final = 1.0
#: Pause before the second, third … attempt after a transient fault.
_BACKOFF_SECONDS: Final = (1.0, 5.0, 30.0)


class Maker(Protocol):
    """Computes products of one stage and stores their objects."""

    def make(self, job: Job) -> Finished:
        """Compute and store one product.

        Raises:
            MissingInput: an input's object is gone.
            TransientError: worth another try.
            ValerieError: it will never work.
        """
        ...


@runtime_checkable
class LooksAhead(Protocol):
    """A maker that makes some products more cheaply together."""

    def expect(self, jobs: Sequence[Job]) -> None:
        """These will be asked for next, one by one and in this order, unless the process ends or another call of this comes."""
        ...


@runtime_checkable
class MayEnd(Protocol):
    """A maker that ends this process where a product takes too long: nothing else stops compiled code."""

    def before_end(self, tell: Callable[[str], None]) -> None:
        """Before that, ``tell(reason)`` is to be called, from any thread, while the product is still being made."""
        ...


def run_stage(context: Context, maker: Maker, digests: Sequence[str]) -> None:
    """Make those of ``digests`` that are still wanted; record what became of each."""
    settings = context.settings
    with writing(context.engine) as connection:
        jobs = products.claim(
            connection, digests, owner=context.owner, now=time.time(), lease_seconds=settings.lease_seconds
        )
    if not jobs:
        return
    pending = {job.digest for job in jobs}
    finished: list[Finished] = []
    if isinstance(maker, LooksAhead):
        maker.expect(jobs)
    current = jobs[0]
    if isinstance(maker, MayEnd):
        maker.before_end(lambda reason: _end(context, current, pending, finished, reason))
    with _heartbeat(context, pending):
        last = time.monotonic()
        for current in jobs:
            made = _attempt(context, maker, current)
            if made is not None:
                finished.append(made)
            if finished and time.monotonic() - last > _PUBLISH_SECONDS:
                _publish(context, finished)
                pending.difference_update(f.digest for f in finished)
                finished, last = [], time.monotonic()
        if finished:
            _publish(context, finished)


def _attempt(context: Context, maker: Maker, job: Job) -> Finished | None:
    """One product; what goes wrong is recorded, never raised, so that the rest of the message is done."""
    try:
        return maker.make(job)
    except MissingInput as error:
        _ask_again(context, job, error)
    except (StorageFull, StorageUnavailable) as error:
        log.warning("stage.storage", digest=job.digest, error=str(error))
        _give_back(context, [job.digest], seconds=0.0, count_attempt=False)
        pause_for_storage(context, error)
    except TransientError as error:
        _again_or_never(context, job, error)
    except MemoryError as error:
        if job.attempts >= context.settings.max_attempts:
            _fail(context, job, error)
        else:
            _give_back(context, [job.digest], seconds=_BACKOFF_SECONDS[0])
    except Exception as error:
        # Also a defect of ours or of an engine must end as a recorded failure of this product, not as a stuck run.
        if not isinstance(error, ValerieError):
            log.exception("stage.defect", digest=job.digest, kind=job.kind)
        _fail(context, job, error)
    return None


def _end(context: Context, job: Job, pending: set[str], finished: Sequence[Finished], reason: str) -> None:
    """This process is about to end in the middle of ``job``: what is finished is kept, what was not begun goes back uncounted."""
    try:
        if finished:
            _publish(context, finished)
        rest = pending - {job.digest, *(one.digest for one in finished)}
        _give_back(context, rest, seconds=0.0, count_attempt=False)
    finally:
        _again_or_never(context, job, TransientError(reason))


def _publish(context: Context, finished: Sequence[Finished]) -> None:
    now = time.time()
    with writing(context.engine) as connection:
        products.publish(connection, finished, owner=context.owner, now=now)
    # In a transaction of its own: see promote_dependents.
    with writing(context.engine) as connection:
        ready = products.promote_dependents(connection, [f.digest for f in finished], now)
    if ready:
        try:
            context.broker.send_products(sorted(ready, key=lambda item: (item[2], item[3])))
        except TransientError as error:
            log.warning("stage.broker", reason=str(error))  # the sweeper rings again


def _fail(context: Context, job: Job, error: BaseException) -> None:
    document = {
        "stage": job.kind,
        "type": type(error).__name__,
        "message": str(error)[:2000] or type(error).__name__,
        "attempts": job.attempts,
    }
    log.error("stage.failed", digest=job.digest, **document)
    with writing(context.engine) as connection:
        products.fail(connection, job.digest, owner=context.owner, error=document, now=time.time())


def _again_or_never(context: Context, job: Job, error: TransientError) -> None:
    """Another attempt after a pause, while there are any left."""
    if job.attempts >= context.settings.max_attempts:
        _fail(context, job, error)
        return
    log.warning("stage.retry", digest=job.digest, kind=job.kind, attempts=job.attempts, error=str(error))
    _give_back(context, [job.digest], seconds=_BACKOFF_SECONDS[min(job.attempts, len(_BACKOFF_SECONDS)) - 1])


def _give_back(context: Context, digests: Iterable[str], *, seconds: float, count_attempt: bool = True) -> None:
    # The sweeper rings for what was not rung for in `resend_seconds`; that long before the pause's end is when it "was".
    with writing(context.engine) as connection:
        products.hand_back(
            connection,
            list(digests),
            owner=context.owner,
            not_before=time.time() + seconds - context.settings.resend_seconds,
            count_attempt=count_attempt,
        )


def _ask_again(context: Context, job: Job, error: MissingInput) -> None:
    if job.attempts >= context.settings.max_attempts:
        _fail(context, job, error)
        return
    log.warning("stage.input_lost", digest=job.digest, input=error.digest)
    now = time.time()
    context.store.delete(product_key(error.kind, error.digest))  # a damaged object must not be taken for the new one
    with writing(context.engine) as connection:
        products.await_inputs(connection, [job.digest], owner=context.owner)
        products.forget(connection, [error.digest])
        ready = products.promote(connection, [error.digest], now)
    try:
        context.broker.send_products(ready)
    except TransientError as failure:
        log.warning("stage.broker", reason=str(failure))


@contextmanager
def _heartbeat(context: Context, pending: set[str]) -> Iterator[None]:
    """Renew the leases of ``pending`` while the body computes."""
    stop = threading.Event()

    def beat() -> None:
        while not stop.wait(context.settings.heartbeat_seconds):
            try:
                with writing(context.engine) as connection:
                    products.renew(
                        connection,
                        list(pending),
                        owner=context.owner,
                        until=time.time() + context.settings.lease_seconds,
                    )
            except TransientError as error:
                log.warning("stage.heartbeat", reason=str(error))

    thread = threading.Thread(target=beat, name="heartbeat", daemon=True)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join(timeout=5)
