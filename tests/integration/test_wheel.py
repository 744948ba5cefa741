"""The wheel of this project: installed away from its sources, it runs the example that it ships."""

from __future__ import annotations

import os
import subprocess
import sys
import sysconfig
import venv
from pathlib import Path

import pytest

from valerie.embedded.redis_server import find_server
from valerie.settings import load_settings

ROOT = Path(__file__).parents[2]

pytestmark = [pytest.mark.slow, pytest.mark.processes, pytest.mark.gl, pytest.mark.timeout(1800)]


def run(*command: str | Path, cwd: Path, **environment: str) -> str:
    """Run a program without the sources on its path; return what it printed."""
    kept = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run(
        list(map(str, command)), cwd=cwd, env={**kept, **environment}, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout + done.stderr


def build(folder: Path, *, umask: str) -> Path:
    """Return the wheel of the last commit."""
    script = f"umask {umask} && exec {ROOT / 'bin' / 'release'} HEAD {folder}"
    run("bash", "-c", script, cwd=ROOT, VENV=sys.prefix)
    (wheel,) = folder.iterdir()
    return wheel


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build(tmp_path_factory.mktemp("first"), umask="022")


def test_a_release_is_built_twice_with_equal_bytes(wheel: Path, tmp_path: Path) -> None:
    again = build(tmp_path / "second", umask="077")
    assert again.name == wheel.name
    assert again.read_bytes() == wheel.read_bytes()


def test_a_wheel_runs_the_shipped_example_away_from_the_sources(wheel: Path, tmp_path: Path) -> None:
    bare = tmp_path / "bare"
    pip = (sys.executable, "-m", "pip", "--disable-pip-version-check")
    venv.create(bare)
    run(*pip, "--python", bare / "bin" / "python", "install", "--no-deps", wheel, cwd=tmp_path)
    # The dependencies are those of this environment; the sources of its editable installation stay out.
    site = next((bare / "lib").glob("python3*/site-packages"))
    (site / "dependencies.pth").write_text(sysconfig.get_path("purelib"))
    away, command = tmp_path / "away", bare / "bin" / "valerie"
    away.mkdir()
    where = Path(run(bare / "bin" / "python", "-c", "import valerie; print(valerie.__file__)", cwd=away).strip())
    assert where.is_relative_to(bare)
    assert (where.parent / "py.typed").exists()
    run(command, "new", "my.yaml", cwd=away)
    spec = away / "my.yaml"
    smaller = spec.read_text("utf-8").replace("width: 960, height: 540", "width: 240, height: 136")
    spec.write_text(smaller.replace("step: 3 m", "step: 9 m"), "utf-8")
    printed = run(command, "run", "my.yaml", cwd=away, VALERIE_REDIS_SERVER=str(find_server(load_settings())))
    assert "mean pACC" in printed
    (report,) = (away / "var" / "reports").glob("*.html")
    assert report.stat().st_size > 0
