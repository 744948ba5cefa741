"""The catalogue and the processes at work, through REST."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor, wait
from pathlib import Path

import httpx
import pytest

from services.api.app import create_app
from tests.world.boxes import write_box_street
from tests.world.drawn import CLASS, FUNCTIONS, DrawnWorld, spec
from tests.world.serving import served
from tests.world.world import settings_of
from valerie.db import processes, totals
from valerie.db.engine import writing
from valerie.errors import TransientError
from valerie.labels import CITYSCAPES
from valerie.pipeline.control import monitoring
from valerie.pipeline.functions import catalog


def test_an_asset_lists_its_parameters_with_bounds_and_units(api: httpx.Client) -> None:
    asset = api.get("/v1/assets/drawn-street").json()
    parameters = {parameter["path"]: parameter for parameter in asset["parameters"]}
    x = parameters["scene.person-1.pos.x"]
    assert (x["type"], x["minimum"], x["maximum"], x["unit"]) == ("FLOAT", -15.0, 15.0, "m")
    assert asset["cameras"] == ["camera-1", "camera-2"]
    assert "obstacles" not in asset


def test_the_list_of_assets_holds_the_built_in_street_and_those_of_the_folder(api: httpx.Client) -> None:
    digests = {one["name"]: one["digest"] for one in api.get("/v1/assets").json()}
    for name in ("urban-street", "drawn-street"):
        assert digests[name] == api.get(f"/v1/assets/{name}").json()["digest"]


def test_a_broken_asset_does_not_hide_the_others(tmp_path: Path) -> None:
    folder = tmp_path / "assets" / "broken"
    folder.mkdir(parents=True)
    (folder / "manifest.yaml").write_text("name: broken\nparameters: 5\n")
    (folder / "manifest.json").write_text("{")
    write_box_street(tmp_path / "assets" / "boxes")
    assets = {asset.name: asset for asset in catalog.assets(settings_of(tmp_path))}
    assert assets["boxes"].problem is None
    assert all(one.problem for name, one in assets.items() if name == "broken")


def test_renderers_and_functions_name_the_classes_that_workers_offer(api: httpx.Client) -> None:
    renderers = {one["name"]: one["numeric_classes"] for one in api.get("/v1/renderers").json()}
    assert (renderers["raster"], renderers["pyrender"]) == ([CLASS], [])
    functions = {one["name"]: one["numeric_classes"] for one in api.get("/v1/functions").json()}
    assert functions == {name: [CLASS] for name in FUNCTIONS}


def test_a_function_whose_file_is_missing_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from valerie.perception.shipped import function_card

    def card(name: str) -> object:
        return function_card(name, folder=tmp_path)

    monkeypatch.setattr(catalog, "function_card", card)
    world = DrawnWorld(settings_of(tmp_path))
    functions = catalog.functions(world.context)
    assert [function.name for function in functions] == list(FUNCTIONS)
    assert all("safetensors" in (function.problem or "") for function in functions)


def test_labels_are_those_of_cityscapes(api: httpx.Client) -> None:
    labels = {one["name"]: (one["id"], one["train_id"], tuple(one["color"])) for one in api.get("/v1/labels").json()}
    assert labels == {label.name: (label.id, label.train_id, label.color) for label in CITYSCAPES}


def test_workers_without_a_recent_sign_of_life_are_not_listed(tmp_path: Path) -> None:
    world = DrawnWorld(settings_of(tmp_path))
    with writing(world.context.engine) as connection:
        assert processes.worker_seen(connection, "drawn-infer", now=1.0, clock_ahead=0.0)
    with served(create_app(world.settings, control=False)) as client:
        assert [one["id"] for one in client.get("/v1/workers").json()] == ["drawn-render", "drawn-eval"]


def test_queues_count_products_messages_and_workers(tmp_path: Path) -> None:
    world = DrawnWorld(settings_of(tmp_path))
    world.work(spec("some"), products=5)
    queues = {queue.route: queue for queue in monitoring.queues(world.context)}
    assert set(queues) == {"eval", f"infer.{CLASS}", f"render.raster.{CLASS}", f"render.truth.{CLASS}"}
    assert {queue.workers for queue in queues.values()} == {1}
    raster = queues[f"render.raster.{CLASS}"]
    assert raster.messages == raster.ready > 0
    assert queues["eval"].waiting > 0


def test_queues_are_shown_without_the_broker(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    world = DrawnWorld(settings_of(tmp_path))
    world.broker.down = True
    assert {queue.messages for queue in monitoring.queues(world.context)} == {None}
    metrics = monitoring.metrics(world.context)
    assert 'valerie_up{part="broker"} 0.0' in metrics
    assert 'valerie_up{part="database"} 1.0' in metrics
    assert "valerie_queue_messages{" not in metrics


def test_metrics_say_that_the_database_does_not_answer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    world = DrawnWorld(settings_of(tmp_path))

    def locked(_: object) -> None:
        raise TransientError("the database is locked")

    monkeypatch.setattr(totals, "backlog", locked)
    metrics = monitoring.metrics(world.context)
    assert 'valerie_up{part="database"} 0.0' in metrics
    assert 'valerie_up{part="broker"} 1.0' in metrics
    assert 'valerie_unknown{metrics="products"} 1.0' in metrics
    assert "valerie_products{" not in metrics
    assert "valerie_workers{" in metrics


def test_readiness_does_not_wait_for_a_store_that_hangs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    world = DrawnWorld(settings_of(tmp_path))
    released = threading.Event()
    requests = []

    def hang(_: object) -> None:
        requests.append(1)
        released.wait(60)

    monkeypatch.setattr(type(world.context.store), "check", hang)
    monkeypatch.setattr(monitoring, "CHECK_SECONDS", 0.1)
    try:
        for _ in range(3):
            answers = monitoring.check(world.context)
            assert (answers["database"], answers["broker"]) == ("ok", "ok")
            assert "does not answer" in answers["artifacts"]
        assert len(requests) == 1, "one thread waits, however often the probe comes"
    finally:
        released.set()


def test_two_probes_at_once_both_have_the_answer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    world = DrawnWorld(settings_of(tmp_path))
    asked, released = threading.Event(), threading.Event()

    def answer_late(_: object) -> None:
        asked.set()
        released.wait(60)

    monkeypatch.setattr(type(world.context.store), "check", answer_late)
    monkeypatch.setattr(monitoring, "CHECK_SECONDS", 60.0)
    with ThreadPoolExecutor(2) as executor:
        first = executor.submit(monitoring.check, world.context)
        assert asked.wait(60)
        second = executor.submit(monitoring.check, world.context)
        wait([second], timeout=0.5)  # it has asked by then, or asks anew
        released.set()
        assert first.result() == second.result() == {"database": "ok", "broker": "ok", "artifacts": "ok"}


def test_the_process_is_alive_without_database_or_broker(api: httpx.Client) -> None:
    assert api.get("/healthz").json()["status"] == "ok"
