"""Run workers as Slurm jobs."""

from __future__ import annotations

import re
import shlex
import subprocess
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from valerie.cli.shell import DataDir
from valerie.errors import InvalidInput, MissingDependency
from valerie.local.deployment import settings_of

if TYPE_CHECKING:
    from valerie.settings import Settings

app = typer.Typer(no_args_is_help=True, help="Run workers as Slurm jobs.")

_IDLE_SECONDS: Final = 300.0
_OPTION: Final = re.compile(r"[a-z][a-z-]*(=.*)?")


@app.callback()
def slurm() -> None:
    """Keep ``submit`` a subcommand, since Typer merges a single one into its parent."""


@app.command()
def submit(
    render: Annotated[int, typer.Option(min=0, help="Number of render workers.")] = 1,
    infer: Annotated[int, typer.Option(min=0, help="Number of inference workers.")] = 1,
    evaluate: Annotated[int, typer.Option("--eval", min=0, help="Number of evaluation workers.")] = 1,
    idle: Annotated[
        float, typer.Option(min=0, max=86_400, help="Seconds without work after which a worker ends.")
    ] = _IDLE_SECONDS,
    options: Annotated[
        list[str] | None,
        typer.Option(
            "--sbatch",
            metavar="[STAGE:]NAME=VALUE",
            help="Option of sbatch without its dashes, as time=04:00:00, or infer:gres=gpu:1 for one stage; repeatable.",
        ),
    ] = None,
    show: Annotated[bool, typer.Option("--show", help="Only print the commands.")] = False,
    data_dir: DataDir = None,
) -> None:
    """Submit one job array of workers per stage, and print the ids of the jobs.

    The workers join the deployment that the settings of this shell describe. They ask its database for work, so
    VALERIE_BROKER_URL may be ``none``. Nodes need the same paths as this machine.
    """
    from valerie.embedded.supervisor import service_environment

    settings = settings_of(data_dir).model_copy(update={"worker_idle_seconds": idle})
    _require_shared(settings)
    counts = {"render": render, "infer": infer, "eval": evaluate}
    for stage, count in counts.items():
        if count == 0:
            continue
        command = _command(stage, count, _options_of(stage, options or (), counts), settings.data_dir)
        if show:
            typer.echo(shlex.join(command))
        else:
            typer.echo(f"{stage}\t{_submitted(command, service_environment(stage, settings))}")


def _require_shared(settings: Settings) -> None:
    """Refuse SQLite, whose locks do not work on network file systems."""
    if settings.database_url.startswith("sqlite"):
        raise InvalidInput(
            "jobs on several nodes need a database server",
            field="VALERIE_DATABASE_URL",
            value=settings.database_url,
            limit="postgresql://…",
        )


def _options_of(stage: str, options: Sequence[str], stages: Collection[str]) -> list[str]:
    """Return the options of one stage: those without a stage before a colon, and its own."""
    arguments = []
    for option in options:
        prefix, _, rest = option.partition(":")
        own = rest if prefix in stages else option
        if not _OPTION.fullmatch(own):
            raise InvalidInput(
                "not an option", field="--sbatch", value=option, limit="NAME, NAME=VALUE or STAGE:NAME=VALUE"
            )
        if prefix == stage or prefix not in stages:
            arguments.append(f"--{own}")
    return arguments


def _command(stage: str, count: int, options: list[str], data_dir: Path) -> list[str]:
    from valerie.embedded.guarded_process import python_command
    from valerie.embedded.supervisor import WORKERS

    logs = data_dir / "logs"
    return [
        "sbatch",
        "--parsable",
        f"--job-name=valerie-{stage}",
        f"--array=1-{count}",
        f"--output={logs}/slurm-{stage}-%A_%a.log",
        "--requeue",  # a node may fail, or a job of more importance take it
        "--export=ALL",
        *options,
        # The worker replaces the shell, so that Slurm's signals reach it.
        f"--wrap=exec {shlex.join(python_command(WORKERS[stage]))}",
    ]


def _submitted(command: list[str], environment: dict[str, str]) -> str:
    """Submit a job, and return its id."""
    (Path(environment["VALERIE_DATA_DIR"]) / "logs").mkdir(parents=True, exist_ok=True)
    try:
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    except FileNotFoundError:
        raise MissingDependency("sbatch is not on the path: call this on a login node of Slurm") from None
    if done.returncode:
        raise InvalidInput(f"sbatch refuses the job: {done.stderr.strip()}", field="--sbatch")
    return done.stdout.strip().partition(";")[0]
