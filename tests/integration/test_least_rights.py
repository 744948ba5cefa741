"""Each stage works with the rights of deploy/s3 and deploy/postgres and no others.

Moto enforces the policies of the bucket, Postgres the rights of the roles.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import boto3
import psycopg
import pytest
from sqlalchemy import make_url, text
from sqlalchemy.exc import ProgrammingError

from tests.world.blank import Pipeline
from tests.world.boxes import spec, write_box_street
from tests.world.bucket import s3_server
from tests.world.world import Watched
from valerie.errors import StorageUnavailable
from valerie.pipeline.base.context import Context
from valerie.pipeline.base.fitness import Fitness
from valerie.pipeline.control.loop import ControlLoop
from valerie.pipeline.functions.probe import probe_engine, probe_function
from valerie.pipeline.functions.specimen_making import Specimens
from valerie.pipeline.work.asking import ask_for_work
from valerie.pipeline.work.makers.evaluation import EvaluateMaker
from valerie.pipeline.work.makers.inference import InferMaker
from valerie.pipeline.work.makers.rendering import RenderMaker
from valerie.pipeline.work.workers import Presence
from valerie.runs.products.pins import Probed
from valerie.runs.products.states import EVAL_QUEUE, ProductKind, Stage
from valerie.storage import open_store
from valerie.storage.keys import function_key, product_key, run_key
from valerie.storage.store import ArtifactStore

ROOT = Path(__file__).parents[2]
BUCKET, PREFIX = "valerie", "adas"
ROLES = ("render", "infer", "eval", "api")
#: Rows that no worker needs.
OF_PEOPLE = ("tokens", "audit", "deliveries", "studies", "selections", "notes")

pytestmark = [pytest.mark.processes, pytest.mark.timeout(600)]


def policy(role: str) -> str:
    text = (ROOT / "deploy" / "s3" / f"{role}.json").read_text("utf-8")
    return text.replace("BUCKET/PREFIX", f"{BUCKET}/{PREFIX}").replace("BUCKET", BUCKET)


@pytest.fixture(scope="module")
def stores(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, ArtifactStore]]:
    """The store as each role sees it."""
    set_up = 1 + 3 * len(ROLES)
    with (
        s3_server(tmp_path_factory.mktemp("moto"), INITIAL_NO_AUTH_ACTION_COUNT=str(set_up)) as url,
        pytest.MonkeyPatch.context() as patch,
    ):
        keys = {"aws_access_key_id": "test", "aws_secret_access_key": "test", "region_name": "us-east-1"}
        boto3.client("s3", endpoint_url=url, **keys).create_bucket(Bucket=BUCKET)
        iam = boto3.client("iam", endpoint_url=url, **keys)
        patch.setenv("AWS_REGION", "us-east-1")
        patch.setenv("AWS_DISABLE_BULK_DELETE", "true")  # a request for several keys, moto judges by the bucket only
        opened = {}
        for role in ROLES:
            iam.create_user(UserName=role)
            iam.put_user_policy(UserName=role, PolicyName=role, PolicyDocument=policy(role))
            key = iam.create_access_key(UserName=role)["AccessKey"]
            patch.setenv("AWS_ACCESS_KEY_ID", key["AccessKeyId"])
            patch.setenv("AWS_SECRET_ACCESS_KEY", key["SecretAccessKey"])
            opened[role] = open_store(f"s3://{BUCKET}/{PREFIX}", s3_endpoint=url)
        yield opened


class Deployment(NamedTuple):
    """One process whose stages have rights of their own."""

    pipeline: Pipeline
    contexts: dict[Stage, Context]
    routes: dict[Stage, list[str]]

    def run(self, document: dict[str, Any]) -> str:
        """Submit a run, and let the stages work until it ended; return its id."""
        run_id = self.pipeline.submit(document)
        for _ in range(200):
            self.pipeline.loop.tick(everything=True)
            for stage in Stage:
                ask_for_work(self.contexts[stage], self.makers[stage], self.routes[stage], threading.Event())
            if self.pipeline.row(run_id).state.is_final:
                return run_id
        raise AssertionError(self.pipeline.row(run_id))

    @property
    def makers(self) -> dict[Stage, Any]:
        return self.pipeline.makers


@pytest.fixture(scope="module")
def deployment(
    stores: dict[str, ArtifactStore], new_database: Callable[[], str], tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Deployment]:
    folder, url = tmp_path_factory.mktemp("deployment"), make_url(new_database())
    write_box_street(folder / "assets" / "box-street")
    owner = url.render_as_string(hide_password=False)
    pipeline = Pipeline(folder / "api", folder / "assets", workers=False, database_url=owner)
    pipeline.context = replace(pipeline.context, store=stores["api"])
    pipeline.loop = ControlLoop(pipeline.context)
    with psycopg.connect(owner, autocommit=True) as connection:
        for _ in range(2):  # again after an upgrade
            connection.execute((ROOT / "deploy" / "postgres" / "roles.sql").read_bytes())
        for stage in Stage:
            connection.execute(f"ALTER ROLE valerie_{stage} PASSWORD 'secret'".encode())
    specimens: Specimens = {}
    offers = {
        Stage.RENDER: probe_engine("blank", specimens),
        Stage.INFER: probe_function("blank", specimens),
        Stage.EVAL: [],
    }
    makers: dict[Stage, Any] = {Stage.RENDER: RenderMaker, Stage.INFER: InferMaker, Stage.EVAL: EvaluateMaker}
    contexts, presences = {}, []
    for stage in Stage:
        account = url.set(username=f"valerie_{stage}", password="secret").render_as_string(hide_password=False)
        changes = {"database_url": account, "data_dir": folder / stage, "worker_idle_seconds": 0.0}
        settings = pipeline.settings.model_copy(update=changes)
        presences.append(Presence(settings, stage))
        assert presences[-1].specimen_keys() <= specimens.keys()
        presences[-1].join(Probed(offers=tuple(offers[stage]), specimens=specimens))
        opened = presences[-1].open_context(settings, Fitness.counts())
        contexts[stage] = replace(opened, store=stores[stage], broker=pipeline.context.broker)
        pipeline.makers[stage] = Watched(makers[stage](contexts[stage]))
    routes = {stage: sorted({offer.route for offer in offers[stage]}) or [EVAL_QUEUE] for stage in Stage}
    yield Deployment(pipeline, contexts, routes)
    for presence in presences:
        presence.leave()
    for context in (pipeline.context, *contexts.values()):
        context.engine.dispose()


def test_runs_complete_with_the_rights_of_each_stage(deployment: Deployment, stores: dict[str, ArtifactStore]) -> None:
    run = deployment.run(spec(xs=2, ys=1) | {"annotations": ["normals"]})
    assert (deployment.pipeline.state(run), deployment.pipeline.row(run).reason) == ("completed", None)
    kinds = {info.key.split("/")[1] for info in stores["api"].list("products")}
    assert kinds >= {"background", "layer", "truth", "normals", "prediction"}
    # Lost inputs are removed and made again, pictures that are not kept removed.
    damaged = [info.key for info in stores["api"].list("products/layer")]
    for key in damaged:
        stores["api"].put(key, b"damaged", replace=True)
    bright = spec(xs=2, ys=1) | {"retention": "numbers", "sensors": [{"exposure_ev": 1.0}]}
    again = deployment.run(bright)
    assert (deployment.pipeline.state(again), deployment.pipeline.row(again).reason) == ("completed", None)
    for key in damaged:
        assert stores["api"].get(key) != b"damaged"


def test_the_policies_let_a_stage_write_what_it_makes(stores: dict[str, ArtifactStore]) -> None:
    kinds = {kind for kind in ProductKind if kind.has_object}
    for role in ROLES[:3]:
        written = {
            resource.removeprefix(f"arn:aws:s3:::{BUCKET}/{PREFIX}/").removesuffix("/*")
            for statement in json.loads(policy(role))["Statement"]
            if "s3:PutObject" in statement["Action"]
            for resource in statement["Resource"]
        }
        own = {f"products/{kind}" for kind in kinds if kind.stage == role}
        assert written == own | ({"runs"} if role == Stage.EVAL else set())


@pytest.mark.parametrize("role", ROLES[:3])
def test_a_stage_writes_nothing_that_another_makes(role: str, stores: dict[str, ArtifactStore]) -> None:
    foreign = [product_key(kind, "0" * 32) for kind in ProductKind if kind.has_object and kind.stage != role]
    foreign += [function_key("0" * 64, "onnx"), "probe-1"]
    if role != Stage.EVAL:
        foreign.append(run_key("0abc", "report.html"))
    for key in foreign:
        stores["api"].put(key, b"right", replace=True)
        for replacing in (True, False):
            with pytest.raises(StorageUnavailable):
                stores[role].put(key, b"falsified", replace=replacing)
        assert stores["api"].get(key) == b"right"


def test_functions_are_read_by_inference_only_and_removed_by_no_worker(stores: dict[str, ArtifactStore]) -> None:
    key = function_key("1" * 64, "onnx")
    stores["api"].put(key, b"weights")
    assert stores["infer"].get_range(key, 0, 7) == b"weights"
    for role in ("render", "eval"):
        with pytest.raises(StorageUnavailable):
            stores[role].get(key)
    for role in ROLES[:3]:
        with pytest.raises(StorageUnavailable):
            stores[role].delete(key)


def test_the_results_of_runs_are_removed_by_no_worker(stores: dict[str, ArtifactStore]) -> None:
    key = run_key("0abc", "summary.json")
    stores["eval"].put(key, b"{}", replace=True)
    assert stores["eval"].get(key) == b"{}"
    for role in ROLES[:3]:
        with pytest.raises(StorageUnavailable):
            stores[role].delete(key)


@pytest.mark.parametrize("stage", Stage)
@pytest.mark.parametrize(
    "statement",
    [
        *(f"SELECT * FROM {table}" for table in OF_PEOPLE),
        "INSERT INTO tokens DEFAULT VALUES",
        "INSERT INTO audit DEFAULT VALUES",
        "INSERT INTO runs (id) VALUES ('x')",
        "UPDATE runs SET spec = NULL",
        "DELETE FROM runs",
        "DELETE FROM products",
        "UPDATE functions SET name = 'x'",
        "DROP TABLE scores",
        "CREATE TABLE planted (x int)",
    ],
)
def test_the_role_of_a_stage_reaches_no_rows_of_people(deployment: Deployment, stage: Stage, statement: str) -> None:
    engine = deployment.contexts[stage].engine
    with engine.connect() as connection, pytest.raises(ProgrammingError, match=r"denied|must be owner"):
        connection.execute(text(statement))


@pytest.mark.parametrize(
    ("stage", "table"),
    [(Stage.RENDER, "scores"), (Stage.INFER, "scores"), (Stage.EVAL, "person_views"), (Stage.INFER, "person_views")],
)
def test_the_role_of_a_stage_changes_no_measures_of_another(deployment: Deployment, stage: Stage, table: str) -> None:
    for statement in (f"DELETE FROM {table}", f"INSERT INTO {table} DEFAULT VALUES"):
        with deployment.contexts[stage].engine.connect() as connection, pytest.raises(ProgrammingError, match="denied"):
            connection.execute(text(statement))
