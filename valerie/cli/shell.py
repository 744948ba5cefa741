"""Parts that commands share: exit codes, error messages, signals, common options, settings and consoles."""

from __future__ import annotations

import io
import json
import os
import pwd
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from enum import IntEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Final, NoReturn, TextIO

import typer

from valerie.errors import InvalidInput, NotFound, StorageUnavailable, ValerieError
from valerie.local.terminal import command_name, console

if TYPE_CHECKING:
    from valerie.pipeline.base.context import Context


class Exit(IntEnum):
    """Exit codes of every command; ``valerie --help`` lists them."""

    OK = 0
    DEFECT = 1
    INVALID_INPUT = 2
    COMPLETED_WITH_FAILURES = 3
    NOT_COMPLETED = 4
    ENVIRONMENT = 5
    GATE_FAILED = 6
    TOOK_TOO_LONG = 124


class Stopped(SystemExit):  # not an error: the user asked for the end
    """A signal asked this process to end. It unwinds like an exception and exits with 128 + signal number."""

    def __init__(self, signum: int) -> None:
        self.signum = signum
        super().__init__(128 + signum)


DataDir = Annotated[
    Path | None,
    typer.Option("--data-dir", help="Folder for database, artifacts and logs.", show_default="var/valerie"),
]
Url = Annotated[
    str | None,
    typer.Option("--url", help="Address of a server.", show_default="the one that runs on the data folder"),
]
InferenceThreads = Annotated[
    int | None,
    typer.Option("--threads", min=1, help="CPU threads of the inference engine.", show_default="the same as workers"),
]
UrlOrFolder = Annotated[
    str | None, typer.Option("--url", help="Address of a server.", show_default="read the data folder")
]
_IN_REPORTS: Final = "reports/ next to the data folder"
ReportOfRun = Annotated[Path | None, typer.Option("--report", help="File for the report.", show_default=_IN_REPORTS)]
ReportFile = Annotated[Path | None, typer.Option("--output", "-o", help="File to write.", show_default=_IN_REPORTS)]
RunId = Annotated[str, typer.Argument(metavar="RUN", help="Id of a run, as `valerie status` lists it.")]
RunIds = Annotated[list[str], typer.Argument(metavar="RUN", help="Ids of runs, as `valerie status` lists them.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON.")]
EndWithParent = Annotated[bool, typer.Option("--end-with-parent", hidden=True)]


def say(text: str = "") -> None:
    """Print a line for people to standard error, since standard output is for results."""
    sys.stderr.write(text + "\n")
    sys.stderr.flush()


def print_json(document: object, *, indent: int | None = None) -> None:
    """Print a document as JSON to standard output, on one line without ``indent``."""
    typer.echo(json.dumps(document, ensure_ascii=False, indent=indent))


@contextmanager
def recorded(context: Context, change: str) -> Iterator[None]:
    """Write a row of the audit log before a change that a command makes to the database directly, and one with its exit code.

    Args:
        context: the deployment.
        change: the command with the name of what it changes, without secrets.
    """
    from secrets import token_hex

    from valerie.access import COMMAND
    from valerie.db import audit
    from valerie.db.engine import database_moment, writing

    mark = token_hex(8)
    try:
        user = pwd.getpwuid(os.getuid()).pw_name
    except KeyError:  # in a container, a user may have only a number
        user = f"uid {os.getuid()}"

    def append(status: int | None) -> None:
        with writing(context.engine) as connection:
            at, host = database_moment(connection), os.uname().nodename[:64]
            path = f"valerie {change}"[:1000]
            audit.append(connection, audit.Entry(mark, at, COMMAND, user[:200], None, host, COMMAND, path, status))

    append(None)
    try:
        yield
    except ValerieError as error:
        append(exit_code_of(error))
        raise
    append(Exit.OK)


def exit_code_of(error: ValerieError) -> Exit:
    """Return the exit code for an error."""
    from valerie.client import ServerProblemError

    if isinstance(error, ServerProblemError):
        return Exit.INVALID_INPUT if error.is_callers_fault else Exit.ENVIRONMENT
    return Exit.INVALID_INPUT if isinstance(error, InvalidInput | NotFound) else Exit.ENVIRONMENT


def show_error(text: str) -> None:
    """Print an error message in red, without a stack trace."""
    from rich.text import Text

    message = Text("error: ", style="bold red")
    message.append(text, style="red")
    console(stderr=True).print(message)


def guarded(command: Callable[[], None], *, debug: bool) -> NoReturn:
    """Run a command line, and end the process with the exit code for its result."""
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
        show_error(f"a bug in VALERIE ({type(error).__name__}: {error}); `valerie --debug …` shows a stack trace")
        sys.exit(Exit.DEFECT)
    finally:
        for stream in (sys.stdout, sys.stderr):
            with suppress(SystemExit):  # the command has ended, and keeps its exit code
                stream.flush()
    sys.exit(Exit.OK)


class _Stream(io.TextIOWrapper):
    """A standard stream that ends the command quietly if its reader ends (``valerie plan … | head``).

    Click and rich do not see the broken pipe, since both would exit with 1.

    Attributes:
        exit_code: see `decide`.
    """

    exit_code: ClassVar[Exit] = Exit.OK

    @classmethod
    def of(cls, stream: TextIO | None) -> TextIO:
        """Wrap a stream; output to one that was closed before this process started is discarded."""
        if stream is None:
            return open(os.devnull, "w", encoding="utf-8")  # noqa: PTH123  stays open as long as this process
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
        # The rest of the buffer must not be written either, when Python flushes it at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), self.fileno())
        raise SystemExit(self.exit_code)


def decide(code: Exit) -> Exit:
    """Set the exit code for the case that the reader of the output leaves (``valerie gate RUN | head``), and return it.

    A command that judges calls it before it prints: a failed gate must not pass because nobody reads it to the end.
    """
    _Stream.exit_code = code
    return code


def stop_on_signals() -> None:
    """Let SIGINT, SIGTERM and SIGHUP unwind this process; a second signal ends it at once.

    In either case no process remains, since the processes of the one-machine mode end with their parent.
    """

    def stop(signum: int, _frame: object) -> None:
        for number in signals:
            signal.signal(number, lambda n, _: os._exit(128 + n))
        raise Stopped(signum)

    signals = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    for number in signals:
        if signal.getsignal(number) is not signal.SIG_IGN:  # nohup ignores SIGHUP
            signal.signal(number, stop)


def save(content: bytes, path: Path) -> Path:
    """Write a file that the user requested, and return its path as people would type it.

    Raises:
        StorageUnavailable: the file cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    except OSError as error:
        raise StorageUnavailable(f"{path} cannot be written: {error.strerror}") from error
    return path.relative_to(Path.cwd()) if path.is_relative_to(Path.cwd()) else path


def require_format(output: Path | None, formats: Sequence[str]) -> None:
    """Refuse an output file whose suffix is none of ``formats``.

    Raises:
        InvalidInput: it is another one.
    """
    if output is not None and output.suffix not in formats:
        raise InvalidInput("unknown file format", field="--output", value=str(output), limit=", ".join(formats))


def write_output(path: Path, content: bytes) -> None:
    """Write a file that the user asked for, and say so.

    Raises:
        StorageUnavailable: it cannot be written.
    """
    say(f"wrote {save(content, path)}")


def write_template(package: str, path: Path, *, force: bool, then: str) -> None:
    """Write the commented ``template.yaml`` of a package to a file, or print it for ``-``, and say what comes next.

    Args:
        package: with the template.
        path: of the file.
        force: True replaces an existing file.
        then: the command that takes the file, such as ``plan``.

    Raises:
        InvalidInput: the file exists, or cannot be written.
    """
    from valerie.document import template

    text = template(package)
    if str(path) == "-":
        sys.stdout.write(text)
        return
    try:
        with path.open("w" if force else "x", encoding="utf-8") as stream:
            stream.write(text)
    except FileExistsError:
        raise InvalidInput("the file exists; --force replaces it", value=str(path)) from None
    except OSError as error:
        raise InvalidInput(f"the file cannot be written ({error.strerror})", value=str(path)) from error
    say(f"wrote {path}; see what it costs with: {command_name()} {then} {path}")
