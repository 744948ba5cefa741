"""Open functions with a deployment's settings, without its database."""

from __future__ import annotations

from pathlib import Path

from valerie import plugins
from valerie.perception.base import PerceptionFunction
from valerie.perception.documents.function import FunctionDocument
from valerie.perception.running.opening import open_function
from valerie.settings import Settings


def open_installed(name: str, settings: Settings, *, threads: int) -> PerceptionFunction:
    """Call `valerie.plugins.create_function` with this deployment's settings."""
    return plugins.create_function(
        name, threads=threads, device=settings.infer_device, precision=settings.infer_precision
    )


def open_function_document(
    document: FunctionDocument, payload: Path | None, settings: Settings, *, threads: int
) -> PerceptionFunction:
    """Call `open_function` with this deployment's settings."""
    return open_function(
        document, payload, threads=threads, device=settings.infer_device, addresses=settings.http_addresses
    )
