"""A run with tolerance on real worker processes of three numeric classes, of which two agree; one dies and comes back."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import psutil
import pytest

from tests.world.boxes import spec, write_box_street
from tests.world.processes import kill
from valerie.db import processes, runs
from valerie.db.engine import reading
from valerie.db.migrate import migrate
from valerie.pipeline.base.context import open_context
from valerie.pipeline.base.resolved_runs import read_run
from valerie.pipeline.control.loop import ControlLoop
from valerie.pipeline.control.submit import submit
from valerie.pipeline.reading.tables import read_table
from valerie.pipeline.work.finish import finish_run
from valerie.pipeline.work.makers.evaluation import EvaluateMaker
from valerie.pipeline.work.stages import serve_queue
from valerie.runs.products.states import EVAL_QUEUE, RunState, Stage
from valerie.runs.resolving.spec import parse
from valerie.settings import load_settings

pytestmark = [pytest.mark.processes, pytest.mark.timeout(600)]

#: Numeric class of each machine to the radiance that its results differ by; the last one differs too much.
MACHINES = {"blank-a": "0", "blank-b": "0.001", "blank-c": "0.2"}
#: 60 places and two cameras.
DOCUMENT = spec(xs=10, ys=6) | {"reproducible": "tolerance"}


class Cluster:
    """A deployment whose render and inference workers are processes on machines of `MACHINES`; the rest is in this process."""

    def __init__(self, folder: Path, assets: Path, **settings: Any) -> None:
        self.settings = load_settings(
            {}, data_dir=folder, asset_dir=assets, broker_url="none", testing_engines=True, min_free_mb=0,
            worker_idle_seconds=300.0, lease_seconds=15.0, heartbeat_seconds=3.0, sweep_seconds=0.5, **settings,
        )  # fmt: skip
        self.context = open_context(self.settings)
        migrate(self.context.engine)
        self._loop = ControlLoop(self.context)
        self._evaluate = EvaluateMaker(self.context)
        self._workers: dict[tuple[str, Stage], subprocess.Popen[bytes]] = {}

    def start(self, machine: str, stage: Stage) -> None:
        only = {"VALERIE_RENDER_ENGINES": "blank", "VALERIE_INFER_FUNCTIONS": "blank", "VALERIE_INFER_ENGINES": "none"}
        difference = {"VALERIE_TEST_BLANK_CLASS": machine, "VALERIE_TEST_BLANK_SHIFT": MACHINES[machine]}
        path = {name: os.environ[name] for name in ("PATH", "PYTHONPATH") if name in os.environ}
        self._workers[machine, stage] = subprocess.Popen(
            [sys.executable, "-m", f"services.{stage}_worker"],
            env={**path, **self.settings.environment(), **only, **difference},
        )

    def kill(self, machine: str, stage: Stage) -> None:
        worker = self._workers.pop((machine, stage))
        kill([psutil.Process(worker.pid)])
        worker.wait()

    def end(self) -> None:
        for machine, stage in list(self._workers):
            self.kill(machine, stage)
        self.context.engine.dispose()

    def offered(self) -> set[str]:
        with reading(self.context.engine) as connection:
            return {offer.route for offer in processes.offers(connection, now=time.time())}

    def wait(self, done: Callable[[], bool], *, running: bool = True) -> None:
        """Run the parts of this process until something is so."""
        latest = time.monotonic() + 180.0
        while not done():
            assert time.monotonic() < latest, (self.offered(), self.products())
            if running:
                self._loop.tick(everything=True)
                serve_queue(self.context, self._evaluate, EVAL_QUEUE)
                with reading(self.context.engine) as connection:
                    finishing = runs.in_states(connection, (RunState.FINISHING,))
                for run in finishing:
                    finish_run(self.context, run.id)
            time.sleep(0.02)

    def row(self, run_id: str) -> runs.RunRow:
        with reading(self.context.engine) as connection:
            return runs.get(connection, run_id)

    def products(self) -> dict[str, dict[str, int]]:
        """Return queue to the number of products in each state."""
        counts: dict[str, dict[str, int]] = {}
        with reading(self.context.engine) as connection:
            for route, state, count in connection.exec_driver_sql(
                "SELECT route, state, count(*) FROM products GROUP BY route, state"
            ):
                counts.setdefault(route, {})[state] = count
        return counts

    def rows(self, run_id: str) -> list[dict[str, Any]]:
        """Return the rows of the long table, without the names of the run and its frames, sorted."""
        table = read_table(self.context.engine, read_run(self.context, run_id))
        rows = table.arrow.drop_columns(["run_id", "frame_id"]).to_pylist()
        return sorted(rows, key=lambda row: (row["variant_index"], row["camera"]))


@pytest.fixture
def clusters(
    tmp_path: Path, new_database: Callable[[], str], monkeypatch: pytest.MonkeyPatch
) -> Iterator[Callable[..., Cluster]]:
    """Start a deployment on a database, and machines on it that join together."""
    monkeypatch.setattr(processes, "ALIVE_SECONDS", 8.0)
    write_box_street(tmp_path / "assets" / "box-street")
    with ExitStack() as stack:

        def start(database: str, *together: Sequence[str]) -> Cluster:
            own = {"database_url": new_database()} if database == "postgres" else {}
            cluster = Cluster(tmp_path / database, tmp_path / "assets", **own)
            stack.callback(cluster.end)
            # Those that agree come first, since the first decides.
            for count, joining in enumerate(together, start=1):
                for machine in joining:
                    for stage in (Stage.RENDER, Stage.INFER):
                        cluster.start(machine, stage)
                offers = 3 * sum(map(len, together[:count]))
                cluster.wait(lambda offers=offers: len(cluster.offered()) == offers, running=False)
            return cluster

        yield start


def test_two_classes_share_a_run_the_third_makes_nothing_and_a_death_changes_no_row(
    clusters: Callable[..., Cluster],
) -> None:
    calm = clusters("sqlite", ["blank-a", "blank-b"], ["blank-c"])
    run = submit(calm.context, parse(DOCUMENT))
    calm.wait(lambda: calm.row(run).state is RunState.COMPLETED)
    expected = calm.rows(run)

    by_place: dict[tuple[float, float], set[tuple[str, ...]]] = {}
    for row in expected:
        place = (row["scene.person-1.pos.x"], row["scene.person-1.pos.y"])
        by_place.setdefault(place, set()).add((row["render_class"], row["truth_class"], row["infer_class"]))
    assert len(by_place) == 60
    assert all(len(classes) == 1 for classes in by_place.values())
    for column in ("render_class", "infer_class"):
        assert {row[column] for row in expected} == {"blank-a", "blank-b"}
    made = calm.products()
    assert {route for route in made if route not in ("", EVAL_QUEUE)} == {  # statics are stored with truths
        f"{queue}.blank-{one}" for queue in ("render.blank", "render.truth", "infer") for one in "ab"
    }
    assert all(set(states) == {"done"} for states in made.values())
    calm.end()

    struck = clusters("postgres", ["blank-a", "blank-b"])
    run = submit(struck.context, parse(DOCUMENT))
    route = "infer.blank-b"
    struck.wait(lambda: "done" in struck.products().get("render.blank.blank-b", {}))
    struck.kill("blank-b", Stage.INFER)
    struck.wait(lambda: struck.row(run).reason == f"no living worker serves the queue {route}")
    # All others go on until nothing is left that does not need it.
    struck.wait(lambda: set(struck.products()["infer.blank-a"]) == {"done"})
    assert struck.row(run).state is RunState.RUNNING
    assert set(struck.products()[route]) - {"done"}
    struck.start("blank-b", Stage.INFER)
    struck.wait(lambda: struck.row(run).state is RunState.COMPLETED)
    assert struck.rows(run) == expected
