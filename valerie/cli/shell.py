"""How commands talk to a shell: exit codes, errors in one message, signals, settings and consoles."""

from __future__ import annotations

import io
import os
import shutil
import signal
import sys
from collections.abc import Callable
from contextlib import suppress
from enum import IntEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn, TextIO

import typer

from valerie.errors import InvalidInput, NotFound, ValerieError

if TYPE_CHECKING:
    from rich.console import Console

    from valerie.settings import Settings


class Exit(IntEnum):
    """Exit codes of every command; ``valerie --help`` lists them."""

    OK = 0
    DEFECT = 1
    INVALID_INPUT = 2
    COMPLETED_WITH_FAILURES = 3
    NOT_COMPLETED = 4
    ENVIRONMENT = 5
    TOOK_TOO_LONG = 124


class Stopped(SystemExit):  # no error: somebody asked for the end
    """A signal asked this process to end; unwinds like an exception, exits with 128 + its number."""

    def __init__(self, signum: int) -> None:
        self.signum = signum
        super().__init__(128 + signum)


DataDir = Annotated[
    Path | None,
    typer.Option("--data-dir", help="Folder of database, artifacts and logs.", show_default="var/valerie"),
]
Url = Annotated[
    str | None,
    typer.Option("--url", help="Address of a server.", show_default="the one that runs on the data folder"),
]
InferenceThreads = Annotated[
    int | None,
    typer.Option("--threads", min=1, help="CPU threads of the inference engine.", show_default="as workers have"),
]
Json = Annotated[bool, typer.Option("--json", help="Print JSON for machines.")]
EndWithParent = Annotated[bool, typer.Option("--end-with-parent", hidden=True)]


def settings_of(data_dir: Path | None = None) -> Settings:
    """Settings of this process; an option wins over the environment.

    Raises:
        InvalidInput: a variable is not accepted.
    """
    from valerie.settings import load_settings

    return load_settings(data_dir=data_dir)


def console(*, stderr: bool = False) -> Console:
    """A console for people; plain text when it is no terminal or NO_COLOR is set."""
    from rich.console import Console

    from valerie.cli.piped import PipedConsole

    stream = sys.stderr if stderr else sys.stdout
    return Console(stderr=stderr, highlight=False, markup=False) if stream.isatty() else PipedConsole(stderr=stderr)


def say(text: str = "") -> None:
    """One line for people beside the result: to standard error."""
    sys.stderr.write(text + "\n")
    sys.stderr.flush()


def exit_code_of(error: ValerieError) -> Exit:
    """Which exit code tells this error."""
    from valerie.client import ServerProblemError

    if isinstance(error, ServerProblemError):
        return Exit.INVALID_INPUT if error.is_callers_fault else Exit.ENVIRONMENT
    return Exit.INVALID_INPUT if isinstance(error, InvalidInput | NotFound) else Exit.ENVIRONMENT


def show_error(text: str) -> None:
    """One message in red, without a stack trace."""
    from rich.text import Text

    message = Text("error: ", style="bold red")
    message.append(text, style="red")
    console(stderr=True).print(message)


def guarded(command: Callable[[], None], *, debug: bool) -> NoReturn:
    """Run a command line and end the process with the exit code that fits."""
    stop_on_signals()
    sys.stdout, sys.stderr = _Stream.of(sys.stdout), _Stream.of(sys.stderr)
    try:
        command()
    except ValerieError as error:
        if debug:
            raise
        show_error(str(error))
        sys.exit(exit_code_of(error))
    except Exception as error:
        if debug:
            raise
        show_error(f"a defect of VALERIE ({type(error).__name__}: {error}); `valerie --debug …` shows where")
        sys.exit(Exit.DEFECT)
    finally:
        for stream in (sys.stdout, sys.stderr):
            with suppress(SystemExit):  # the command is done, and keeps its exit code
                stream.flush()
    sys.exit(Exit.OK)


class _Stream(io.TextIOWrapper):
    """A standard stream whose reader may leave (``valerie plan … | head``): then the command ends, and that is no error.

    Neither click nor rich hears of it: both would exit with 1.
    """

    @classmethod
    def of(cls, stream: TextIO | None) -> TextIO:
        """The same stream; what goes to one that was closed before this process began goes nowhere."""
        if stream is None:
            return open(os.devnull, "w", encoding="utf-8")  # noqa: PTH123  open as long as this process
        if not isinstance(stream, io.TextIOWrapper):
            return stream
        return cls(
            stream.buffer,
            encoding=stream.encoding,
            errors=stream.errors,
            line_buffering=stream.line_buffering,
            write_through=stream.write_through,
        )

    def write(self, text: str, /) -> int:
        try:
            return super().write(text)
        except BrokenPipeError:
            self._end()

    def flush(self) -> None:
        try:
            super().flush()
        except BrokenPipeError:
            self._end()

    def _end(self) -> NoReturn:
        # Nothing more can be written here, not even at exit what the buffer still holds.
        os.dup2(os.open(os.devnull, os.O_WRONLY), self.fileno())
        raise SystemExit(Exit.OK)


def stop_on_signals() -> None:
    """Let SIGINT, SIGTERM and SIGHUP unwind this process in order; a second one ends it at once.

    Ending at once leaves nothing behind either: the processes of the one-machine mode notice and end themselves.
    """

    def stop(signum: int, _frame: object) -> None:
        for number in watched:
            signal.signal(number, lambda n, _: os._exit(128 + n))
        raise Stopped(signum)

    watched = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    for number in watched:
        if signal.getsignal(number) is not signal.SIG_IGN:  # as under nohup
            signal.signal(number, stop)


def command_name() -> str:
    """How the user can call this program again: ``valerie`` if that finds it, else its path from here."""
    program = Path(sys.argv[0]).absolute()
    if program.name != "valerie":
        return "python -m valerie"
    found = shutil.which("valerie")
    if found is not None and Path(found).resolve() == program.resolve():
        return "valerie"
    return os.path.relpath(program) if program.is_relative_to(Path.cwd()) else str(program)


def read_spec(path: Path) -> bytes:
    """The text of a spec file, or of standard input for ``-``.

    Raises:
        InvalidInput: it cannot be read or is far too large.
    """
    from valerie.loading import MAX_BYTES

    try:
        if str(path) == "-":
            text = sys.stdin.buffer.read(MAX_BYTES + 1)
        else:
            with path.open("rb") as stream:
                text = stream.read(MAX_BYTES + 1)
    except OSError as error:
        raise InvalidInput(f"the spec cannot be read ({error.strerror})", value=str(path)) from error
    if len(text) > MAX_BYTES:
        raise InvalidInput("the spec is too large", value=str(path), limit=f"{MAX_BYTES} bytes")
    return text
