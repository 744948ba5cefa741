"""Rules of all tests: a clean environment, patience on slow machines, no skip without a reviewed reason."""

from __future__ import annotations

import gc
import os
import resource
import signal
from collections.abc import Iterator
from contextlib import closing
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import settings

if TYPE_CHECKING:
    from valerie.rendering.ground_truth import TruthPass
    from valerie.rendering.raster.renderer import RasterRenderer

# A setting of the developer's shell must not decide what a test sees.
for _name in [name for name in os.environ if name.startswith("VALERIE_") and not name.startswith("VALERIE_TEST_")]:
    del os.environ[_name]

# Started in the background (`nohup`, a script's `&`), a test run inherits ignored signals, and so would all that it starts.
for _number, _handler in ((signal.SIGINT, signal.default_int_handler), (signal.SIGHUP, signal.SIG_DFL)):
    if signal.getsignal(_number) is signal.SIG_IGN:
        signal.signal(_number, _handler)

# Machines differ in speed; what a property says does not.
settings.register_profile("valerie", deadline=None)
settings.load_profile("valerie")

#: A worker process keeps the bound of its functions until it ends; tests share one process.
_MEMORY_LIMITS = resource.getrlimit(resource.RLIMIT_DATA)

#: Files and folders whose tests run on one worker, and the name of what they share. They begin first, since they take longest.
_TOGETHER = {
    "tests/acceptance/test_kills.py": "systems",
    "tests/acceptance/test_releases.py": "systems",
    "tests/integration/": "systems",
    "tests/urban_street/": "street",
}

_ALLOWED = Path(__file__).with_name("allowed_skips.txt")


@pytest.fixture(autouse=True)
def memory_limit_of_no_function() -> Iterator[None]:
    """Lift what functions of earlier tests have left behind."""
    resource.setrlimit(resource.RLIMIT_DATA, _MEMORY_LIMITS)
    yield
    resource.setrlimit(resource.RLIMIT_DATA, _MEMORY_LIMITS)


@pytest.fixture(scope="session")
def raster() -> Iterator[RasterRenderer]:
    from valerie.rendering.raster.renderer import RasterRenderer

    with closing(RasterRenderer()) as engine:
        yield engine


@pytest.fixture(scope="session")
def truth_pass() -> Iterator[TruthPass]:
    from valerie.rendering.ground_truth import TruthPass

    with closing(TruthPass()) as truth_pass:
        yield truth_pass


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Iterator[None]:
    """Collect without looking for garbage, leave the tests out of later searches, which they outlive, and search seldom."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.set_threshold(10_000, 10, 50)
        gc.enable()


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Tests that need Docker, Blender, a cluster or another environment run when asked for by path, and then never skip."""
    for name in ("cluster", "compose", "cycles", "rocrate"):
        folder = Path(__file__).with_name(name)
        if collection_path == folder and not any(f"tests/{name}" in str(argument) for argument in config.args):
            return True
    return None


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Order the tests as `_TOGETHER` is, and all others after them."""
    places = [*_TOGETHER, ""]
    items.sort(key=lambda item: next(i for i, path in enumerate(places) if item.nodeid.startswith(path)))


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """A file's tests stay together. Those that start whole systems stay on one worker, since two systems at a time would only
    wait for each other; and so do those of the street, which is built and painted once.
    """
    from xdist.scheduler import LoadScopeScheduling

    class Scheduling(LoadScopeScheduling):
        def _split_scope(self, nodeid: str) -> str:
            file = nodeid.partition("::")[0]
            return next((name for path, name in _TOGETHER.items() if file.startswith(path)), file)

    return Scheduling(config, log)


def pytest_configure(config: pytest.Config) -> None:
    config.pluginmanager.register(SkipPolice(read_allowed(_ALLOWED.read_text())), "skip-police")


def read_allowed(text: str) -> list[tuple[str, str]]:
    """(pattern of ids, part of the reason) of each line that is no comment."""
    lines = [line.strip() for line in text.splitlines()]
    entries = [line.partition("|") for line in lines if line and not line.startswith("#")]
    return [(pattern.strip(), reason.strip()) for pattern, _, reason in entries]


class SkipPolice:
    """Fails the session when a test was skipped, or expected to fail, that the reviewed list does not name."""

    def __init__(self, allowed: list[tuple[str, str]]) -> None:
        self._allowed = allowed
        self._caught: list[str] = []

    def _look(self, report: pytest.TestReport | pytest.CollectReport) -> None:
        expected_failure = getattr(report, "wasxfail", None)
        if not report.skipped and expected_failure is None:
            return
        reason = expected_failure
        if reason is None:
            reason = report.longrepr[2] if isinstance(report.longrepr, tuple) else str(report.longrepr)
        if not any(fnmatchcase(report.nodeid, pattern) and part in reason for pattern, part in self._allowed):
            self._caught.append(f"{report.nodeid}: {reason}")

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self._look(report)

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        self._look(report)

    @pytest.hookimpl(wrapper=True)
    def pytest_sessionfinish(self, session: pytest.Session) -> Iterator[None]:
        # Before the terminal's own hook, which shows the exit status.
        if self._caught and session.exitstatus in (pytest.ExitCode.OK, pytest.ExitCode.NO_TESTS_COLLECTED):
            session.exitstatus = pytest.ExitCode.TESTS_FAILED
        yield

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        if self._caught:
            terminalreporter.section("skips that tests/allowed_skips.txt does not allow", sep="=", red=True)
            for line in self._caught:
                terminalreporter.line(line)
