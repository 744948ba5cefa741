"""The terminal: consoles, and the name of the command that the user types."""

from __future__ import annotations

import os
import shutil
import sys
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console


def console(*, stderr: bool = False) -> Console:
    """Return a console for people; it prints plain text if it is not a terminal or NO_COLOR is set."""
    from rich.console import Console

    from valerie.local.piped import PipedConsole

    stream = sys.stderr if stderr else sys.stdout
    return Console(stderr=stderr, highlight=False, markup=False) if stream.isatty() else PipedConsole(stderr=stderr)


def command_name() -> str:
    """Return the command with which the user can start this program: ``valerie`` if it is on the PATH, else a path."""
    program = Path(sys.argv[0]).absolute()
    if program.name != "valerie":
        return "python -m valerie"
    on_path = shutil.which("valerie")
    if on_path is not None and Path(on_path).resolve() == program.resolve():
        return "valerie"
    return os.path.relpath(program) if program.is_relative_to(Path.cwd()) else str(program)
