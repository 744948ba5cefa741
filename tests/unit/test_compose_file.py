"""The compose file: what its services get, without an engine (`tests/compose` starts them)."""

from __future__ import annotations

import re
from ipaddress import ip_address, ip_network
from pathlib import Path
from typing import Any

import pytest
import yaml

ROOT = Path(__file__).parents[2]
STAGES = {"render_worker": "RENDER", "cycles_worker": "RENDER", "infer_worker": "INFER", "eval_worker": "EVAL"}


@pytest.fixture(scope="module")
def compose() -> dict[str, Any]:
    found: dict[str, Any] = yaml.safe_load((ROOT / "docker-compose.yml").read_text("utf-8"))
    return found


@pytest.fixture(scope="module")
def services(compose: dict[str, Any]) -> dict[str, Any]:
    found: dict[str, Any] = compose["services"]
    return found


@pytest.mark.parametrize(("service", "stage"), STAGES.items())
def test_a_stage_may_have_credentials_of_its_own(services: dict[str, Any], service: str, stage: str) -> None:
    environment = services[service]["environment"]
    for variable in ("VALERIE_DATABASE_URL", "AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"):
        own, fallback = re.fullmatch(r"\$\{(\w+):-(.*)\}", environment[variable]).groups()  # type: ignore[union-attr]
        assert own == f"{stage}_{variable.removeprefix('VALERIE_')}"
        assert fallback == services["api"]["environment"][variable]
    assert "VALERIE_API_TOKEN" not in environment


def test_every_service_is_read_only_and_limited(services: dict[str, Any]) -> None:
    for name, service in services.items():
        assert service["read_only"] is True, name
        assert service["mem_limit"], name
        assert service["pids_limit"], name
        assert "no-new-privileges:true" in service["security_opt"], name
        assert service["cap_drop"] == ["ALL"], name


def test_the_api_trusts_the_proxy_alone_which_reaches_nothing_else(
    compose: dict[str, Any], services: dict[str, Any]
) -> None:
    address = services["proxy"]["networks"]["edge"]["ipv4_address"]
    assert services["api"]["environment"]["VALERIE_TRUSTED_PROXIES"] == address
    (network,) = compose["networks"]["edge"]["ipam"]["config"]
    assert ip_address(address) in ip_network(network["subnet"])
    assert [*services["proxy"]["networks"]] == ["edge"]
    assert {name for name, service in services.items() if "edge" in service.get("networks", ())} == {"api", "proxy"}
    published = {name for name, service in services.items() if "ports" in service}
    assert published == {"api", "proxy"}
    assert services["proxy"]["profiles"] == ["tls"]
