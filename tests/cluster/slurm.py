"""A Slurm cluster of one node for tests, from Debian's packages."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import psutil
import pytest

from tests.cluster.rabbitmq import free_port

_SECONDS = 60.0


@contextmanager
def slurm(folder: Path) -> Iterator[dict[str, str]]:
    """Start controller and node; gives the environment of Slurm's commands.

    Fails the test where Slurm is not installed, since these tests run only when they are asked for.
    """
    missing = [name for name in ("munged", "slurmctld", "slurmd", "sbatch") if shutil.which(name) is None]
    if missing or os.geteuid() != 0:
        pytest.fail(f"Slurm needs root and {', '.join(missing)}: apt-get install slurm-wlm munge")
    folder.chmod(0o755)
    host = socket.gethostname().partition(".")[0]
    for name in ("state", "spool", "munge"):
        (folder / name).mkdir()
    key = folder / "munge" / "key"
    key.write_bytes(os.urandom(128))
    key.chmod(0o400)
    cores = os.cpu_count() or 1
    configuration = folder / "slurm.conf"
    configuration.write_text(
        f"""
ClusterName=valerie
SlurmctldHost={host}(127.0.0.1)
SlurmUser=root
SlurmctldPort={free_port()}
SlurmdPort={free_port()}
CommunicationParameters=NoInAddrAny
AuthInfo=socket={folder}/munge/socket
CredType=cred/munge
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
OverTimeLimit=0
ReturnToService=2
MpiDefault=none
KillWait=10
NodeName={host} NodeAddr=127.0.0.1 CPUs={cores} RealMemory=1000 State=UNKNOWN
PartitionName=all Nodes={host} Default=YES OverSubscribe=FORCE:8 MaxTime=INFINITE State=UP
"""
    )
    environment = {**os.environ, "SLURM_CONF": str(configuration)}
    munge = [
        "munged", "--foreground", "--force", f"--socket={folder}/munge/socket", f"--key-file={key}",
        f"--pid-file={folder}/munge/pid", f"--log-file={folder}/munge/log", f"--seed-file={folder}/munge/seed",
    ]  # fmt: skip
    with ExitStack() as running:
        for command in (munge, ["slurmctld", "-D"], ["slurmd", "-D"]):
            running.enter_context(_process(command, environment, folder))
        _await_idle(environment, folder)
        yield environment
        subprocess.run(["scancel", "--full", "--user=root"], env=environment, check=False)
        _await(lambda: not _output(["squeue", "--noheader"], environment), folder)


@contextmanager
def _process(command: list[str], environment: dict[str, str], folder: Path) -> Iterator[None]:
    with (folder / f"{command[0]}.out").open("wb") as output:
        process = subprocess.Popen(command, env=environment, stdout=output, stderr=output)
    try:
        yield
    finally:
        steps = psutil.Process(process.pid).children(recursive=True) if process.poll() is None else []
        process.terminate()
        try:
            process.wait(20)
        except subprocess.TimeoutExpired:
            process.kill()
        for step in steps:
            if step.is_running():
                step.kill()


def _await_idle(environment: dict[str, str], folder: Path) -> None:
    _await(lambda: "idle" in _output(["sinfo", "--noheader", "--format=%T"], environment), folder)


def _await(holds: object, folder: Path) -> None:
    deadline = time.monotonic() + _SECONDS
    while not holds():  # type: ignore[operator]
        logs = [
            path.read_text(errors="replace")[-2000:] for path in folder.glob("*.*") if path.suffix in (".log", ".out")
        ]
        assert time.monotonic() < deadline, "\n".join(logs)
        time.sleep(0.2)


def _output(command: list[str], environment: dict[str, str]) -> str:
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=False).stdout.strip()
