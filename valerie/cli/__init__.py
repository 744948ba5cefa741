"""The ``valerie`` command."""

from valerie.cli.main import main

__all__ = ["main"]
