"""The files for Kubernetes: built by kustomize, valid by schemas, restricted, and without loose ends.

The schemas are those of Kubernetes, and of KEDA's two kinds a description of the fields that the files use.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import time
from ipaddress import IPv4Network
from pathlib import Path
from typing import Any

import jsonschema
import kubernetes_validate
import pytest
import yaml

from tests.world.world import settings_of
from valerie.db.engine import open_database
from valerie.db.migrate import migrate
from valerie.pipeline.control.monitoring import Demand
from valerie.pipeline.work.workers import Presence
from valerie.plugins import RENDERERS
from valerie.runs.products.pins import Probed
from valerie.runs.products.states import Stage
from valerie.settings import load_settings

ROOT = Path(__file__).parents[2] / "deploy" / "kubernetes"
VERSIONS = ["1.28", "1.34"]
#: Reached by nobody (RFC 5737).
PLACEHOLDER = IPv4Network("192.0.2.0/24")
Objects = list[dict[str, Any]]


def fields(required: dict[str, Any], **optional: Any) -> dict[str, Any]:
    """The schema of an object with these fields and no others."""
    properties = required | optional
    return {"type": "object", "properties": properties, "required": [*required], "additionalProperties": False}


TEXT, COUNT = {"type": "string", "minLength": 1}, {"type": "integer", "minimum": 0}
TRIGGER = fields(
    {
        "type": {"const": "metrics-api"},
        "metadata": fields(
            {
                "url": {"type": "string", "pattern": "^http://"},
                "valueLocation": TEXT,
                "targetValue": {"type": "string", "pattern": "^[0-9]+$"},  # KEDA reads it from text
                "authMode": {"const": "bearer"},
            }
        ),
        "authenticationRef": fields({"name": TEXT}),
    }
)
OF_KEDA = {
    "ScaledJob": fields(
        {"jobTargetRef": {"type": "object"}, "triggers": {"type": "array", "items": TRIGGER, "minItems": 1}},
        pollingInterval=COUNT,
        minReplicaCount=COUNT,
        maxReplicaCount=COUNT,
        successfulJobsHistoryLimit=COUNT,
        failedJobsHistoryLimit=COUNT,
        rollout=fields({"strategy": {"enum": ["default", "gradual"]}}),
        scalingStrategy=fields(
            {"strategy": {"enum": ["default", "custom", "accurate", "eager"]}},
            multipleScalersCalculation={"enum": ["max", "min", "avg", "sum"]},
        ),
    ),
    "TriggerAuthentication": fields(
        {
            "secretTargetRef": {
                "type": "array",
                "items": fields({"parameter": {"const": "token"}, "name": TEXT, "key": TEXT}),
            }
        }
    ),
}


def built(folder: Path) -> Objects:
    if shutil.which("kubectl") is None:
        pytest.fail("kubectl is not installed: apt-get install kubernetes-client")
    done = subprocess.run(["kubectl", "kustomize", folder], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return list(yaml.safe_load_all(done.stdout))


@pytest.fixture(scope="module", params=["site", "everything"])
def objects(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Objects:
    """What is applied by the files as they are, and with every part that they offer."""
    if request.param == "site":
        return built(ROOT / "site")
    folder = tmp_path_factory.mktemp("everything")
    parts = {name: os.path.relpath(ROOT / name, folder) for name in ("site", "gpu", "cycles", "assets", "priority")}
    kustomization = {
        "resources": [parts["site"], parts["gpu"], parts["cycles"]],
        "components": [parts["assets"], parts["priority"]],
    }
    (folder / "kustomization.yaml").write_text(yaml.safe_dump(kustomization))
    return built(folder)


def of_kind(objects: Objects, kind: str) -> dict[str, dict[str, Any]]:
    """The objects of one kind by name."""
    return {entry["metadata"]["name"]: entry for entry in objects if entry["kind"] == kind}


def job_of(scaled: dict[str, Any]) -> dict[str, Any]:
    """The job that KEDA makes of a ScaledJob."""
    return {
        "apiVersion": "batch/v1",
        "kind": "Job",
        "metadata": scaled["metadata"],
        "spec": scaled["spec"]["jobTargetRef"],
    }


def templates(objects: Objects) -> dict[str, dict[str, Any]]:
    """The template of the pods of each workload."""
    jobs = {name: job_of(scaled) for name, scaled in of_kind(objects, "ScaledJob").items()}
    workloads = jobs | of_kind(objects, "Deployment")
    return {name: workload["spec"]["template"] for name, workload in workloads.items()}


def workers(objects: Objects) -> dict[str, dict[str, Any]]:
    """The pod of each pool of workers."""
    found = {name: template["spec"] for name, template in templates(objects).items() if name != "api"}
    assert {"render", "infer", "eval"} <= set(found)
    return found


@pytest.mark.parametrize("version", VERSIONS)
def test_every_object_fits_the_schema_of_kubernetes(objects: Objects, version: str) -> None:
    for entry in objects:
        if entry["kind"] in OF_KEDA:
            jsonschema.validate(entry["spec"], OF_KEDA[entry["kind"]])
        if entry["kind"] != "TriggerAuthentication":
            entry = job_of(entry) if entry["kind"] == "ScaledJob" else entry
            kubernetes_validate.validate(entry, version, strict=True)


@pytest.mark.parametrize(
    ("kind", "field", "value"),
    [
        ("ScaledJob", "minReplicas", 0),
        ("ScaledJob", "scalingStrategy", {"strategy": "fast"}),
        ("TriggerAuthentication", "secretTargetRef", [{"parameter": "token", "name": "valerie-api"}]),
    ],
)
def test_the_description_of_keda_refuses_a_wrong_field(kind: str, field: str, value: object) -> None:
    (entry, *_) = of_kind(built(ROOT / "site"), kind).values()
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(entry["spec"] | {field: value}, OF_KEDA[kind])


def test_every_pod_is_restricted(objects: Objects) -> None:
    for name, template in templates(objects).items():
        pod = template["spec"]
        assert pod["securityContext"]["runAsNonRoot"] is True, name
        assert pod["securityContext"]["seccompProfile"] == {"type": "RuntimeDefault"}, name
        assert pod["automountServiceAccountToken"] is False, name
        for container in pod["containers"] + pod.get("initContainers", []):
            assert container["securityContext"] == {
                "allowPrivilegeEscalation": False,
                "readOnlyRootFilesystem": True,
                "capabilities": {"drop": ["ALL"]},
            }, name
            assert container["resources"]["limits"]["memory"], name
        for volume in pod["volumes"]:
            assert "emptyDir" not in volume or volume["emptyDir"]["sizeLimit"], name


def test_every_pod_has_known_settings_and_only_the_secret_of_its_stage(
    objects: Objects, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    shared = of_kind(objects, "ConfigMap")["valerie"]["data"]
    secrets = {}
    for name, template in templates(objects).items():
        pod = template["spec"]
        for container in pod["containers"] + pod.get("initContainers", []):
            secrets[name] = [entry["secretRef"]["name"] for entry in container["envFrom"] if "secretRef" in entry]
            assert {"configMapRef": {"name": "valerie"}} in container["envFrom"], name
            assert all("valueFrom" not in entry for entry in container.get("env", [])), name
        variables = shared | {entry["name"]: entry["value"] for entry in pod["containers"][0].get("env", [])}
        variables |= {"VALERIE_DATABASE_URL": "postgresql://h/d", "VALERIE_DATA_DIR": str(tmp_path)}
        assert "VALERIE_API_TOKEN" not in variables, name
        with monkeypatch.context() as patch:
            for variable, value in variables.items():
                patch.setenv(variable, value)
            settings = load_settings()
        assert name == "api" or settings.worker_idle_seconds, name
    expected = {
        "api": "valerie-api", "render": "valerie-render", "cycles": "valerie-render",
        "infer": "valerie-infer", "infer-gpu": "valerie-infer", "eval": "valerie-eval",
    }  # fmt: skip
    assert secrets == {name: [expected[name]] for name in secrets}


def test_pools_scale_by_numbers_that_the_api_has(objects: Objects) -> None:
    known = {*Demand._fields, *(f"render.{name}" for name in (*RENDERERS, "truth"))}
    triggers = [trigger for scaled in of_kind(objects, "ScaledJob").values() for trigger in scaled["spec"]["triggers"]]
    named = {trigger["metadata"]["valueLocation"] for trigger in triggers}
    assert {"render.raster", "render.truth", "infer", "eval"} <= named <= known
    (secret,) = of_kind(objects, "TriggerAuthentication")["api-token"]["spec"]["secretTargetRef"]
    assert secret == {"parameter": "token", "name": "valerie-api", "key": "VALERIE_API_TOKEN"}
    assert {trigger["authenticationRef"]["name"] for trigger in triggers} == {"api-token"}


def test_pods_reach_only_what_the_policies_name(objects: Objects) -> None:
    policies = of_kind(objects, "NetworkPolicy")
    roles = {name: template["metadata"]["labels"]["valerie/role"] for name, template in templates(objects).items()}
    assert roles == {name: "api" if name == "api" else "worker" for name in roles}
    everybody = {"matchExpressions": [{"key": "valerie/role", "operator": "Exists"}]}
    assert policies["closed"]["spec"]["podSelector"] == everybody
    assert policies["closed"]["spec"]["policyTypes"] == ["Ingress", "Egress"]
    for name, policy in policies.items():
        rules = policy["spec"].get("egress", []) + policy["spec"].get("ingress", [])
        assert name == "closed" or rules
        for rule in rules:
            assert rule["ports"], name
            peers = rule.get("to") or rule["from"]  # a rule without them lets everybody through
            for peer in peers:
                narrow = {*peer} == {"namespaceSelector", "podSelector"} and all(
                    selector["matchLabels"] for selector in peer.values()
                )
                assert narrow or IPv4Network(peer["ipBlock"]["cidr"]).subnet_of(PLACEHOLDER), name
    entered = {name for name, policy in policies.items() if policy["spec"].get("ingress")}
    assert entered == {"api"}
    assert policies["api"]["spec"]["podSelector"] == {"matchLabels": {"valerie/role": "api"}}


def test_a_worker_without_signs_of_life_is_found_by_its_probes(objects: Objects, tmp_path: Path) -> None:
    settings = settings_of(tmp_path)
    migrate(open_database(settings.database_url))
    commands = set()
    for pod in workers(objects).values():
        (container,) = pod["containers"]
        for probe in (container["startupProbe"], container["livenessProbe"]):
            shell, option, script = probe["exec"]["command"]
            commands.add((shell, option, script.replace("/var/lib/valerie", str(tmp_path))))
    (command,) = commands

    def alive() -> bool:
        return subprocess.run(command, check=False, capture_output=True).returncode == 0

    assert not alive()
    presence = Presence(settings, Stage.RENDER)
    presence.join(Probed(offers=()))
    assert alive()
    presence.leave()
    assert not alive()
    silent = tmp_path / "health" / "render-host-1"
    silent.touch()
    os.utime(silent, (time.time() - 300,) * 2)
    assert not alive()


def test_an_evicted_worker_has_not_failed(objects: Objects) -> None:
    for name, scaled in of_kind(objects, "ScaledJob").items():
        job = scaled["spec"]["jobTargetRef"]
        (rule,) = job["podFailurePolicy"]["rules"]
        assert rule == {"action": "Ignore", "onPodConditions": [{"type": "DisruptionTarget", "status": "True"}]}, name
        pod = job["template"]["spec"]
        assert pod["restartPolicy"] == "Never", name  # without it, Kubernetes refuses the policy
        assert pod["terminationGracePeriodSeconds"] > load_settings({}).shutdown_seconds, name
        safe = job["template"]["metadata"]["annotations"]["cluster-autoscaler.kubernetes.io/safe-to-evict"]
        assert safe == "true", name
    budget = of_kind(objects, "PodDisruptionBudget")["api"]["spec"]
    api = of_kind(objects, "Deployment")["api"]["spec"]
    assert budget["selector"] == api["selector"]
    assert budget["minAvailable"] < api["replicas"]


def test_workers_have_a_priority_below_others_on_request(objects: Objects) -> None:
    classes = of_kind(objects, "PriorityClass")
    named = {pod.get("priorityClassName") for pod in workers(objects).values()}
    assert named == {*classes} if classes else named == {None}
    for entry in classes.values():
        assert entry["value"] < 0
        assert entry["preemptionPolicy"] == "Never"


def test_own_scenes_are_read_from_a_volume_on_request(objects: Objects) -> None:
    claims = of_kind(objects, "PersistentVolumeClaim")
    folder = of_kind(objects, "ConfigMap")["valerie"]["data"].get("VALERIE_ASSET_DIR")
    assert (folder is not None) == bool(claims)
    for name, template in templates(objects).items():
        pod = template["spec"]
        volumes = {entry["name"]: entry["persistentVolumeClaim"] for entry in pod["volumes"] if "emptyDir" not in entry}
        assert {volume["claimName"] for volume in volumes.values()} == set(claims), name
        mounts = {entry["mountPath"]: entry for entry in pod["containers"][0]["volumeMounts"]}
        if claims:
            assert mounts[folder]["readOnly"] is True, name
            assert mounts[folder]["name"] in volumes, name
