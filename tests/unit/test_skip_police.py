"""A skip that nobody reviewed fails the session."""

import os
import subprocess
import sys
from pathlib import Path

CONFTEST = Path(__file__).parents[1] / "conftest.py"

SUITES = {
    "skip": "import pytest\ndef test_one(): pytest.skip('no engine')",
    "mark": "import pytest\n@pytest.mark.skip(reason='no engine')\ndef test_one(): pass",
    "module": "import pytest\npytest.importorskip('no_such_engine', reason='no engine')\ndef test_one(): pass",
    "xfail": "import pytest\n@pytest.mark.xfail(reason='no engine')\ndef test_one(): assert False",
    "xpass": "import pytest\n@pytest.mark.xfail(reason='no engine')\ndef test_one(): pass",
    "pass": "def test_one(): pass",
}


def _run(tmp_path: Path, *suites: str, allowed: str = "") -> subprocess.CompletedProcess[str]:
    (tmp_path / "conftest.py").write_text(CONFTEST.read_text())
    (tmp_path / "allowed_skips.txt").write_text(f"# reviewed\n\n{allowed}\n")
    for suite in suites:
        (tmp_path / f"test_{suite}.py").write_text(SUITES[suite])
    (tmp_path / "pytest.ini").write_text("[pytest]\n")
    return subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(tmp_path)],
        cwd=tmp_path,
        env={**os.environ, "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"},  # they take longer than the tests
        capture_output=True,
        text=True,
        check=False,
    )


def test_every_kind_of_skip_that_the_list_does_not_name_is_reported(tmp_path: Path) -> None:
    done = _run(tmp_path, *SUITES)
    assert done.returncode == 1, done.stdout
    report = done.stdout.partition("allowed_skips.txt does not allow")[2]
    reported = {line.split(".py")[0].removeprefix("test_") for line in report.splitlines() if ": " in line}
    assert reported == {"skip", "mark", "module", "xfail", "xpass"}


def test_one_skip_among_passing_tests_fails_the_session(tmp_path: Path) -> None:
    done = _run(tmp_path, "pass", "skip", allowed="test_skip.py::* | another reason")
    assert done.returncode == 1
    assert "test_skip.py::test_one: Skipped: no engine" in done.stdout


def test_a_skip_that_the_list_names_with_its_reason_is_accepted(tmp_path: Path) -> None:
    assert _run(tmp_path, "pass", "skip", allowed="test_skip.py::test_* | no engine").returncode == 0


def test_without_skips_the_session_passes(tmp_path: Path) -> None:
    done = _run(tmp_path, "pass")
    assert done.returncode == 0
    assert "allowed_skips" not in done.stdout
