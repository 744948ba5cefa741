"""Commands in a shell: exit codes, one clear message, nothing of a stack."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from click.testing import Result
from typer.testing import CliRunner

from valerie.cli.main import app
from valerie.cli.shell import Exit, exit_code_of, save
from valerie.client import ServerProblemError, ServerUnavailableError
from valerie.errors import (
    Conflict,
    InvalidInput,
    MissingDependency,
    NotFound,
    StorageFull,
    StorageUnavailable,
    TransientError,
    UnknownName,
    ValerieError,
)

ROOT = Path(__file__).parents[3]


def _valerie(*arguments: str, cwd: Path, program: str = "", **environment: str) -> subprocess.CompletedProcess[str]:
    """The command as a process; ``program`` runs instead of it, in the same way."""
    command = ["-c", program, *arguments] if program else ["-m", "valerie", *arguments]
    return subprocess.run(
        [sys.executable, *command],
        cwd=cwd,
        env={**os.environ, "PYTHONPATH": str(ROOT), "NO_COLOR": "1", **environment},
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (InvalidInput("x"), Exit.INVALID_INPUT),
        (UnknownName("asset", "x", ["y"]), Exit.INVALID_INPUT),
        (NotFound("run", "x"), Exit.INVALID_INPUT),
        (ServerProblemError(422, "Invalid input", "x"), Exit.INVALID_INPUT),
        (ServerProblemError(404, "Not found", "x"), Exit.INVALID_INPUT),
        (ServerProblemError(507, "No space left", "x"), Exit.ENVIRONMENT),
        (ServerUnavailableError("x"), Exit.ENVIRONMENT),
        (MissingDependency("x"), Exit.ENVIRONMENT),
        (StorageFull("x"), Exit.ENVIRONMENT),
        (TransientError("x"), Exit.ENVIRONMENT),
        (Conflict("x"), Exit.ENVIRONMENT),
    ],
)
def test_errors_have_the_documented_exit_codes(error: ValerieError, code: Exit) -> None:
    assert exit_code_of(error) is code


def test_help_lists_commands_and_exit_codes(tmp_path: Path) -> None:
    done = _valerie("--help", cwd=tmp_path)
    assert done.returncode == 0
    for command in [
        "new",
        "plan",
        "run",
        "up",
        "submit",
        "status",
        "report",
        "replay",
        "worker",
        "train",
        "gc",
        "asset",
    ]:
        assert f" {command} " in done.stdout
    assert "Exit codes" in done.stdout


def test_a_file_that_is_not_there_is_one_message_and_exit_2(tmp_path: Path) -> None:
    done = _valerie("run", "absent.yaml", cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr.strip() == "error: the spec cannot be read (No such file or directory); got absent.yaml"
    assert not list(tmp_path.iterdir())


def test_a_wrong_spec_is_refused_before_anything_is_started(tmp_path: Path) -> None:
    (tmp_path / "spec.yaml").write_text("name: x\nasset: urban-stret\nvary: []\n")
    done = _valerie("run", "spec.yaml", cwd=tmp_path)
    assert done.returncode == 2
    assert "urban-street" in done.stderr
    assert "starting" not in done.stderr
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "var" / "valerie" / "supervisor.lock").exists()


def test_a_spec_of_megabytes_is_refused_by_its_size(tmp_path: Path) -> None:
    (tmp_path / "spec.yaml").write_bytes(b"#" * 10_000_000)
    done = _valerie("plan", "spec.yaml", cwd=tmp_path)
    assert done.returncode == 2
    assert "too large" in done.stderr


def test_a_misspelt_setting_is_refused(tmp_path: Path) -> None:
    done = _valerie("status", cwd=tmp_path, VALERIE_API_PROT="1")
    assert done.returncode == 2
    assert "VALERIE_API_PORT" in done.stderr


def test_no_server_is_exit_5_with_what_to_do(tmp_path: Path) -> None:
    done = _valerie("status", "--url", "http://127.0.0.1:9", cwd=tmp_path)
    assert done.returncode == 5
    assert "valerie up" in done.stderr


def test_wrong_usage_is_exit_2(tmp_path: Path) -> None:
    assert _valerie("run", cwd=tmp_path).returncode == 2
    assert _valerie("no-such-command", cwd=tmp_path).returncode == 2


#: The paper's two lists (section 4): 5 × 2 variants.
_SPEC = """
name: two lists
asset: urban-street
parameters:
  - [p1, scene.person-1.pos.x, FLOAT, 0.0, 20.0]
  - [p2, scene.person-1.pos.y, FLOAT, 0.0, 10.0]
vary:
  - [p1, HOMOGENEOUS, 1.5, 5.5, 1.0]
  - [p2, HOMOGENEOUS, 4.0, 5.0, 1.0]
constants: {sun-1.elevation: 35}
functions: [deeplabv3plus-small]
"""

_DEFECT = "from valerie.cli.shell import guarded\nguarded(lambda: 1 / 0, debug={debug})"


def test_a_defect_is_exit_1_and_says_how_to_see_more(tmp_path: Path) -> None:
    done = _valerie(cwd=tmp_path, program=_DEFECT.format(debug=False))
    assert done.returncode == 1
    assert "a bug in VALERIE (ZeroDivisionError: division by zero)" in done.stderr
    assert "Traceback" not in done.stderr


def test_debug_shows_the_stack(tmp_path: Path) -> None:
    done = _valerie(cwd=tmp_path, program=_DEFECT.format(debug=True))
    assert "Traceback" in done.stderr
    assert done.returncode == 1


_SLEEP = """
import sys, time
from valerie.cli.shell import guarded
def sleep():
    try:
        print("ready", flush=True)
        time.sleep(600)
    finally:
        print("in order", flush=True)
guarded(sleep, debug=False)
"""


@pytest.mark.parametrize("signum", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_signals_unwind_in_order_and_are_the_exit_code(signum: signal.Signals) -> None:
    process = subprocess.Popen([sys.executable, "-c", _SLEEP], cwd=ROOT, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    time.sleep(0.05)
    process.send_signal(signum)
    output, _ = process.communicate(timeout=30)
    assert output == "in order\n"
    assert process.returncode == 128 + signum


def test_a_reader_that_has_seen_enough_is_no_error(tmp_path: Path) -> None:
    program = "from valerie.cli.shell import guarded\nguarded(lambda: [print(n) for n in range(100_000)], debug=False)"
    done = subprocess.run(
        ["bash", "-c", 'set -o pipefail; "$0" -c "$1" | head -n 1', sys.executable, program],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "0\n", "")


def test_a_saved_file_is_named_as_people_would_type_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert save(b"<html>", tmp_path / "a" / "report.html") == Path("a/report.html")
    assert (tmp_path / "a" / "report.html").read_bytes() == b"<html>"


def test_a_file_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(StorageUnavailable, match=r"file/report\.html"):
        save(b"", tmp_path / "file" / "report.html")


@pytest.mark.parametrize("command", [["new"], ["study", "new"]])
def test_new_writes_a_commented_file_and_never_replaces_one(command: list[str], tmp_path: Path) -> None:
    path = tmp_path / "first.yaml"

    def new(*more: str) -> Result:
        return CliRunner().invoke(app, [*command, str(path), *more])

    assert new().exit_code == 0
    text = path.read_text()
    assert text.count("#") > 5
    path.write_text("mine")
    refused = new().exception
    assert isinstance(refused, InvalidInput)
    assert "--force" in str(refused)
    assert path.read_text() == "mine"
    assert new("--force").exit_code == 0
    assert path.read_text() == text


@pytest.mark.parametrize("command", [["new"], ["study", "new"]])
def test_new_writes_through_no_link_to_a_file_that_is_still_missing(command: list[str], tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(tmp_path / "elsewhere")
    assert isinstance(CliRunner().invoke(app, [*command, str(tmp_path / "link")]).exception, InvalidInput)
    assert not (tmp_path / "elsewhere").exists()


def test_plan_needs_no_server_and_leaves_nothing_behind(tmp_path: Path) -> None:
    (tmp_path / "spec.yaml").write_text(_SPEC)
    done = _valerie("plan", "spec.yaml", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    document = json.loads(done.stdout)
    assert {"variants", "frames", "renders", "cpu_seconds", "bytes", "warnings"} <= document.keys()
    assert document["variants"] == 10
    assert [path.name for path in tmp_path.rglob("*")] == ["spec.yaml"]


def test_plan_shows_people_what_would_be_made(tmp_path: Path) -> None:
    (tmp_path / "spec.yaml").write_text(_SPEC)
    done = _valerie("plan", "spec.yaml", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert [line.split()[:2] for line in done.stdout.splitlines() if line.startswith("variants")] == [
        ["variants", "10"]
    ]
    for word in ("background", "layer", "truth", "prediction", "CPU time", "sun-1.elevation 35 deg"):
        assert word in done.stdout
    assert "present" not in done.stdout, "no column of what nobody knows"


def test_a_spec_may_come_from_standard_input(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "valerie", "plan", "-", "--json"],
        input=_SPEC,
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert json.loads(done.stdout)["variants"] == 10


def test_the_version_is_shown_without_a_command(tmp_path: Path) -> None:
    done = _valerie("--version", cwd=tmp_path)
    assert done.returncode == 0
    assert done.stdout.startswith("valerie")


@pytest.mark.parametrize("code", [0, 6])
@pytest.mark.parametrize("lines", [1, 20_000])
def test_a_reader_that_leaves_ends_the_command_quietly_with_its_verdict(lines: int, code: int) -> None:
    # As `valerie plan … | head -0`: few lines break the pipe at the end, many on the way.
    program = f"""
import typer
from valerie.cli.shell import Exit, decide, guarded
from valerie.local.terminal import console

def command():
    code = decide(Exit({code}))
    for number in range({lines}):
        (typer.echo if number % 2 else console().print)("x" * 40)
    raise typer.Exit(code)

app = typer.Typer()
app.command()(command)
guarded(lambda: app(args=[]), debug=False)
"""
    process = subprocess.Popen(
        [sys.executable, "-c", program], env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert process.stdout is not None
    assert process.stderr is not None
    process.stdout.close()
    message = process.stderr.read()
    process.stderr.close()
    assert message == ""
    assert process.wait() == code


def test_training_where_without_a_run_says_what_is_missing() -> None:
    result = CliRunner().invoke(app, ["train", "--where", "pacc < 0.5"])
    assert isinstance(result.exception, InvalidInput)
    assert result.exception.field == "--from"


def test_training_without_anything_shows_its_help() -> None:
    result = CliRunner().invoke(app, ["train"])
    assert result.exit_code == 0
    assert "--where" in result.output


@pytest.mark.parametrize("command", [["status"], ["report", "r1"], ["cancel", "r1"], ["submit", "-"]])
def test_without_a_server_the_message_says_which_command_starts_one(
    command: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("VALERIE_API_PORT", "9")
    result = CliRunner().invoke(app, [*command, "--data-dir", str(tmp_path)], input="name: a\nasset: urban-street\n")
    assert isinstance(result.exception, ServerUnavailableError)
    assert "start one with `valerie up`" in str(result.exception)
