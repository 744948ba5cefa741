"""Send workers messages about products that became ready, after the transaction that made them ready."""

from __future__ import annotations

from collections.abc import Iterable

import structlog

from valerie.errors import TransientError
from valerie.pipeline.base.context import Context
from valerie.runs.products.ready import Ready

log = structlog.get_logger()


def send_ready(context: Context, ready: Iterable[Ready]) -> None:
    """Send messages for products whose rows are committed; the sweeper resends what a stopped broker refuses."""
    products = sorted(ready, key=lambda product: (product.route, product.cache_group))
    try:
        context.broker.send_products(products)
    except TransientError as error:
        log.warning("broker.refused", products=len(products), reason=str(error))
