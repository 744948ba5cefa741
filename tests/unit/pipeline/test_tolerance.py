"""Runs that accept several numeric classes: which workers they accept, and who makes what."""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, ClassVar

import orjson
import pyarrow as pa
import pytest

from tests.world.blank import Pipeline, street_pipeline
from tests.world.boxes import spec
from valerie.analysis.rows.table import EvaluationTable
from valerie.db import long_table, processes
from valerie.db.engine import reading, writing
from valerie.measures import CLASS_COLUMNS
from valerie.pipeline.base.resolved_runs import read_run
from valerie.pipeline.base.run_artifacts import REPORT, SUMMARY, TABLE_PARQUET, read_artifact
from valerie.pipeline.control.planning import plan_run
from valerie.pipeline.evidence.exporting import export_evidence
from valerie.pipeline.evidence.replaying import replay
from valerie.pipeline.functions.probe import probe_engine, probe_function
from valerie.pipeline.reading.frame_details import frame_details
from valerie.pipeline.reading.tables import read_table, table_row, varied_types
from valerie.pipeline.work.finish import finish_run
from valerie.pipeline.work.replay import replay_frame
from valerie.pipeline.work.stages import serve_queue
from valerie.runs.products.frame_keys import FrameKey
from valerie.runs.products.pins import ANY_PINS, TRUTH, AnyOffer, Pins, TolerantPins, numeric_classes
from valerie.runs.products.states import EVAL_QUEUE, Stage, stage_of
from valerie.runs.resolving.spec import parse
from valerie.storage.keys import run_key

#: Radiance that stays within the bounds, and radiance that does not.
WITHIN, BEYOND = "0.001", "0.2"
TOLERANT = spec(xs=4, ys=3) | {"reproducible": "tolerance"}


@pytest.fixture
def world(tmp_path: Path) -> Pipeline:
    return street_pipeline(tmp_path, workers=False)


@pytest.fixture
def join(world: Pipeline, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Sequence[AnyOffer]]:
    """Registers a worker of the blank engine and function in a numeric class."""

    def register(worker: str, numeric_class: str, shift: str = "0", *, only: str = "") -> Sequence[AnyOffer]:
        monkeypatch.setenv("VALERIE_TEST_BLANK_CLASS", numeric_class)
        monkeypatch.setenv("VALERIE_TEST_BLANK_SHIFT", shift)
        specimens: dict[str, bytes] = {}
        offers = [*probe_engine("blank", specimens), *probe_function("blank", specimens)]
        offers = [offer for offer in offers if only in ("", offer.stage)]
        world.offer(worker, *offers)
        with writing(world.context.engine) as connection:
            processes.keep_specimens(connection, specimens)
        return offers

    return register


def pinned(world: Pipeline, document: dict[str, Any] = TOLERANT) -> TolerantPins:
    pins = world.row(world.submit(document)).pins
    assert isinstance(pins, TolerantPins)
    return pins


def test_a_run_with_tolerance_pins_the_classes_that_agree_with_the_first(
    world: Pipeline, join: Callable[..., object]
) -> None:
    join("w1", "blank-a")
    join("w2", "blank-b", WITHIN)
    join("w3", "blank-b", WITHIN)
    join("w4", "blank-c", BEYOND)
    pins = pinned(world)
    assert pins.engine.numeric_class == pins.functions["blank"].numeric_class == "blank-a"
    assert [(one.engine.numeric_class, one.workers) for one in pins.render] == [("blank-a", 1), ("blank-b", 2)]
    assert [(one.functions["blank"].numeric_class, one.workers) for one in pins.infer] == [
        ("blank-a", 1),
        ("blank-b", 2),
    ]
    assert numeric_classes(pins)["image"] == "blank-a (weight 1) or blank-b (weight 2)"
    assert "blank-c" not in pins.model_dump_json()


def test_the_first_class_decides_which_others_agree(world: Pipeline, join: Callable[..., object]) -> None:
    join("w1", "blank-c", BEYOND)
    join("w2", "blank-a")
    join("w3", "blank-b", WITHIN)
    pins = pinned(world)
    assert [one.engine.numeric_class for one in pins.render] == ["blank-c"]
    assert [one.functions["blank"].numeric_class for one in pins.infer] == ["blank-c"]


def test_a_worker_that_lacks_a_part_of_its_stage_is_not_accepted(world: Pipeline, join: Callable[..., object]) -> None:
    join("w1", "blank-a")
    own = join("w2", "blank-b", only=Stage.RENDER)
    assert isinstance(own, list)
    world.offer("w2", *(offer for offer in own if offer.name != TRUTH))
    pins = pinned(world)
    assert [one.engine.numeric_class for one in pins.render] == ["blank-a"]


def test_a_run_of_bits_pins_one_class_in_the_form_of_before(world: Pipeline, join: Callable[..., object]) -> None:
    join("w1", "blank-a")
    join("w2", "blank-b", WITHIN)
    document = spec(xs=4, ys=3)
    pins = world.row(world.submit(document)).pins
    assert type(pins) is Pins
    assert set(pins.model_dump()) == {"engine", "truth", "functions"}
    assert parse(document).digest == parse({**document, "reproducible": "bits"}).digest
    assert "reproducible" not in parse({**document, "reproducible": "bits"}).model_dump()


def test_stored_pins_read_and_lose_nothing(world: Pipeline, join: Callable[..., object]) -> None:
    join("w1", "blank-a")
    join("w2", "blank-b", WITHIN)
    pins = pinned(world)
    again = ANY_PINS.validate_json(ANY_PINS.dump_json(pins))
    assert again == pins
    for x in range(20):
        assignment = dict.fromkeys(pins.place, 0.1 * x)
        assert again.at(assignment) == pins.at(assignment)


class TestSplit:
    """Which class makes what."""

    @pytest.fixture
    def pins(self, world: Pipeline, join: Callable[..., object]) -> TolerantPins:
        join("w1", "blank-a")
        for name in ("w2", "w3", "w4"):
            join(name, "blank-b", WITHIN)
        return pinned(world)

    def test_the_places_are_split_in_proportion_to_the_workers(self, pins: TolerantPins) -> None:
        places = [
            {"scene.person-1.pos.x": 0.1 * x, "scene.person-1.pos.y": 0.2 * y} for x in range(60) for y in range(50)
        ]
        made = Counter(pins.at(place).engine.numeric_class for place in places)
        # Of 3,000 places with p = 3/4: mean 2,250, σ 23.7; five σ.
        assert abs(made["blank-b"] - 2_250) < 119
        both = Counter((own.engine.numeric_class, own.functions["blank"].numeric_class) for own in map(pins.at, places))
        # The stages are split independently: p = 3/16, σ 21.4.
        assert abs(both["blank-a", "blank-b"] - 562) < 107

    def test_a_place_is_the_positions_of_the_persons_whatever_else_varies(self, pins: TolerantPins) -> None:
        assert pins.place == ("scene.person-1.pos.x", "scene.person-1.pos.y")
        place = {"scene.person-1.pos.x": 1.5, "scene.person-1.pos.y": 4.0}
        other = {**place, "scene.sun-1.elevation": 5.0, "scene.person-1.character": "b"}
        assert pins.at(place) is pins.at(other)
        assert pins.at({"scene.person-1.pos.x": 1.5, "scene.person-1.pos.y": 4}) is pins.at(place)

    def test_it_does_not_depend_on_which_worker_was_first(self, world: Pipeline, pins: TolerantPins) -> None:
        turned = TolerantPins(**{**dict(pins), "engine": pins.render[1].engine, "truth": pins.render[1].truth})
        for x in range(50):
            place = {"scene.person-1.pos.x": 0.1 * x, "scene.person-1.pos.y": 3.0}
            assert pins.at(place).engine == turned.at(place).engine

    def test_drawn_variants_are_each_a_place(self, world: Pipeline, pins: TolerantPins) -> None:
        drawn = TOLERANT | {
            "vary": [["sun-1.elevation", "UNIFORM", 10, 60]], "design": "random", "count": 40
        }  # fmt: skip
        own = pinned(world, drawn)
        assert own.place == ("scene.sun-1.elevation",)


def test_products_of_a_place_go_to_the_queues_of_its_classes_and_have_their_digests(
    world: Pipeline, join: Callable[..., object]
) -> None:
    join("w1", "blank-a")
    join("w2", "blank-b", WITHIN)
    run = world.submit(TOLERANT)
    world.loop.tick(everything=True)
    pins = world.row(run).pins
    assert isinstance(pins, TolerantPins)
    routes = Counter(product.route for product in world.products())
    expected: Counter[str] = Counter()
    resolved = read_run(world.context, run).resolved
    for _, assignment in resolved.space.values(0, resolved.space.size):
        own = pins.at(assignment)
        expected[own.truth.route] += 2  # cameras
        expected[own.functions["blank"].route] += 2
    assert {route: routes[route] for route in expected} == dict(expected)
    assert len(expected) == 4, "both classes of both stages have work"
    # A run of bits on one of the classes shares what that class makes here.
    before = {product.digest for product in world.products()}
    world.submit(spec(xs=4, ys=3))
    world.loop.tick(everything=True)
    of_a = {product.digest for product in world.products() if "blank-a" in product.route}
    assert of_a & before


def test_a_plan_names_the_set(world: Pipeline, join: Callable[..., object]) -> None:
    join("w1", "blank-a")
    join("w2", "blank-b", WITHIN)
    (note,) = [note for note in plan_run(world.context, parse(TOLERANT)).notes if "tolerance" in note]
    assert "image: blank-a (weight 1) or blank-b (weight 1)" in note
    assert not [note for note in plan_run(world.context, parse(spec(xs=4, ys=3))).notes if "tolerance" in note]


def test_a_plan_counts_what_the_classes_of_the_places_have_made(world: Pipeline, join: Callable[..., object]) -> None:
    join("w1", "blank-a")
    join("w2", "blank-b", WITHIN)
    world.submit(TOLERANT)
    world.loop.tick(everything=True)
    planned = plan_run(world.context, parse(TOLERANT))
    assert sum(product.needed for product in planned.products) == len(world.products())


class TestWorkedOff:
    """A run that both classes made."""

    SHIFTS: ClassVar = {"blank-a": "0", "blank-b": WITHIN}

    @pytest.fixture
    def become(self, monkeypatch: pytest.MonkeyPatch) -> Callable[[str], None]:
        """Makes this process a machine of a class."""

        def become(numeric_class: str) -> None:
            monkeypatch.setenv("VALERIE_TEST_BLANK_CLASS", numeric_class)
            monkeypatch.setenv("VALERIE_TEST_BLANK_SHIFT", self.SHIFTS[numeric_class])

        return become

    @pytest.fixture
    def run(self, world: Pipeline, join: Callable[..., object], become: Callable[[str], None]) -> str:
        join("w1", "blank-a")
        join("w2", "blank-b", WITHIN)
        run = world.submit(TOLERANT | {"annotations": ["light"]})
        for _ in range(20):
            world.loop.tick(everything=True)
            for numeric_class in self.SHIFTS:
                become(numeric_class)
                for route in {product.route for product in world.products()}:
                    if route.endswith(numeric_class):
                        serve_queue(world.context, world.makers[stage_of(route)], route)
            serve_queue(world.context, world.makers[Stage.EVAL], EVAL_QUEUE)
            finishing, world.broker.finish = world.broker.finish, []
            for one in finishing:
                finish_run(world.context, one)
        assert world.state(run) == "completed"
        return run

    def test_rows_frames_report_and_evidence_name_the_classes(
        self, world: Pipeline, run: str, become: Callable[[str], None], tmp_path: Path
    ) -> None:
        stored = read_run(world.context, run)
        table = read_table(world.context.engine, stored)
        rows = table.arrow.to_pylist()
        by_place = defaultdict(set)
        for row in rows:
            place = (row["scene.person-1.pos.x"], row["scene.person-1.pos.y"])
            by_place[place].add(tuple(row[name] for name in CLASS_COLUMNS))
        assert len(by_place) == 12
        assert {len(classes) for classes in by_place.values()} == {1}
        assert len({row["render_class"] for row in rows}) == len({row["infer_class"] for row in rows}) == 2

        # The stored file has the columns, and the rows of a page are those of the table.
        own = EvaluationTable.from_parquet(pa.BufferReader(read_artifact(world.context, run, TABLE_PARQUET)))
        assert own.arrow.equals(table.arrow)
        varied = varied_types(stored.resolved)
        with reading(world.context.engine) as connection:
            again = [table_row(row, stored, varied) for row in long_table.rows(connection, run)]
        assert EvaluationTable.from_rows(again, varied).arrow.equals(table.arrow)

        # A frame replays on a machine of its class, and says so on another one.
        for row in rows[::7]:
            frame = frame_details(world.context, FrameKey.parse(row["frame_id"]), lambda *_, **__: "")
            (evaluation,) = frame.evaluations
            classes = (frame.render_class, frame.truth_class, evaluation.infer_class)
            assert classes == tuple(row[name] for name in CLASS_COLUMNS)
            become(frame.render_class)
            replayed = {one.kind: one.verdict for one in replay_frame(world.context, FrameKey.parse(row["frame_id"]))}
            assert {replayed[kind] for kind in ("background", "layer", "truth", "light")} == {"equal"}
            same = evaluation.infer_class == frame.render_class
            assert replayed["prediction"].startswith("equal" if same else "cannot be made here: blank runs as")

        report = read_artifact(world.context, run, REPORT).decode()
        assert "blank-a (weight 1) or blank-b (weight 1)" in report
        assert re.search(r"99\.5\s% of a function", report)
        # A frame of each class is evidence.
        frames = {row["render_class"]: {"frame_id": row["frame_id"], "sensor": "default"} for row in rows}
        key = run_key(run, SUMMARY)
        summary = orjson.loads(world.context.store.get(key))
        summary["verdicts"] = list(frames.values())
        world.context.store.put(key, orjson.dumps(summary), replace=True)
        folder = tmp_path / "evidence"
        export_evidence(world.context, run, folder)
        assert ANY_PINS.validate_json((folder / "pins.json").read_text()) == stored.pins
        assert "all classes that agree in 99.9 %" in (folder / "ro-crate-metadata.json").read_text()
        for numeric_class, frame in frames.items():
            become(numeric_class)
            place = frame["frame_id"].removeprefix(f"{run}.")
            verdicts = {picture.file: picture.verdict for picture in replay(folder, 2, world.settings)}
            assert len(verdicts) == 4
            for file, verdict in verdicts.items():
                assert verdict.partition(":")[0] == ("equal" if f"/{place}/" in file else "cannot be made here")

    def test_the_report_of_a_run_of_bits_has_no_such_columns(
        self, world: Pipeline, run: str, become: Callable[[str], None]
    ) -> None:
        become("blank-a")
        bits = world.submit(spec(xs=4, ys=3))
        assert world.run(bits) == "completed"
        table = read_table(world.context.engine, read_run(world.context, bits))
        assert not set(CLASS_COLUMNS) & set(table.arrow.column_names)
        both = EvaluationTable.joined([table, read_table(world.context.engine, read_run(world.context, run))])
        assert both.arrow["render_class"].null_count == len(table)
