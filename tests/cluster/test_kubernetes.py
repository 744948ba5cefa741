"""The files for Kubernetes: built by kustomize, valid by the schemas of Kubernetes, restricted, and without loose ends."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path
from typing import Any

import kubernetes_validate
import pytest
import yaml

from valerie.pipeline.control.monitoring import Demand
from valerie.plugins import RENDERERS
from valerie.settings import load_settings

ROOT = Path(__file__).parents[2] / "deploy" / "kubernetes"
KUSTOMIZATIONS = [ROOT / "base", ROOT / "gpu", ROOT / "cycles"]
VERSIONS = ["1.28", "1.34"]


def built(kustomization: Path) -> list[dict[str, Any]]:
    if shutil.which("kubectl") is None:
        pytest.fail("kubectl is not installed: apt-get install kubernetes-client")
    done = subprocess.run(["kubectl", "kustomize", kustomization], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return list(yaml.safe_load_all(done.stdout))


def job_of(scaled: dict[str, Any]) -> dict[str, Any]:
    """The job that KEDA makes of a ScaledJob."""
    return {
        "apiVersion": "batch/v1",
        "kind": "Job",
        "metadata": scaled["metadata"],
        "spec": scaled["spec"]["jobTargetRef"],
    }


def pods(objects: list[dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """The pod of each workload."""
    kinds = {}
    for entry in objects:
        spec = job_of(entry)["spec"] if entry["kind"] == "ScaledJob" else entry.get("spec", {})
        if "template" in spec:
            kinds[entry["metadata"]["name"]] = spec["template"]["spec"]
    return kinds


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("kustomization", KUSTOMIZATIONS, ids=lambda path: path.name)
def test_every_object_fits_the_schema_of_kubernetes(kustomization: Path, version: str) -> None:
    objects = built(kustomization)
    assert objects
    for entry in objects:
        if entry["kind"] == "TriggerAuthentication":
            continue  # of KEDA, with the two fields that its operator reads
        entry = job_of(entry) if entry["kind"] == "ScaledJob" else entry
        kubernetes_validate.validate(entry, version, strict=True)


@pytest.mark.parametrize("kustomization", KUSTOMIZATIONS, ids=lambda path: path.name)
def test_every_pod_is_restricted(kustomization: Path) -> None:
    workloads = pods(built(kustomization))
    assert len(workloads) >= 4
    for name, pod in workloads.items():
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


@pytest.mark.parametrize("kustomization", KUSTOMIZATIONS, ids=lambda path: path.name)
def test_workers_have_known_settings_and_not_the_token(
    kustomization: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    objects = built(kustomization)
    (shared,) = [entry["data"] for entry in objects if entry["kind"] == "ConfigMap"]
    for name, pod in pods(objects).items():
        (container,) = pod["containers"]
        variables = {entry["name"]: entry.get("value", "x") for entry in container.get("env", [])} | shared
        if name != "api":
            assert "VALERIE_API_TOKEN" not in variables, name
            assert {"secretRef": {"name": "valerie"}} not in container["envFrom"], name
        variables["VALERIE_DATABASE_URL"] = "postgresql://h/d"
        variables["VALERIE_DATA_DIR"] = str(tmp_path)
        with monkeypatch.context() as patch:
            for variable, value in variables.items():
                patch.setenv(variable, value)
            settings = load_settings()
        assert name == "api" or settings.worker_idle_seconds, name


@pytest.mark.parametrize("kustomization", KUSTOMIZATIONS, ids=lambda path: path.name)
def test_pools_scale_by_numbers_that_the_api_has(kustomization: Path) -> None:
    objects = built(kustomization)
    known = {*Demand._fields, *(f"render.{name}" for name in (*RENDERERS, "truth"))}
    named = {
        trigger["metadata"]["valueLocation"]
        for entry in objects
        if entry["kind"] == "ScaledJob"
        for trigger in entry["spec"]["triggers"]
    }
    assert {"render.raster", "render.truth", "infer", "eval"} <= named <= known
