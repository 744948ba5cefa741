"""Settings: defaults that work, errors that name the variable."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from pydantic import ValidationError

from valerie.errors import InvalidInput, UnknownName
from valerie.settings import Settings, load_settings


@pytest.fixture(autouse=True)
def _clean(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in list(os.environ):
        if name.startswith("VALERIE_"):
            monkeypatch.delenv(name)


def test_everything_of_a_default_deployment_lies_below_the_data_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    settings = load_settings()
    assert settings.data_dir == tmp_path / "var/valerie"
    assert settings.database_url == f"sqlite:///{tmp_path}/var/valerie/valerie.sqlite3"
    assert settings.artifacts_url == str(tmp_path / "var/valerie/artifacts")
    assert (settings.api_host, settings.api_port) == ("127.0.0.1", 8700)


def test_a_variable_sets_its_field(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("VALERIE_DATABASE_URL", "postgresql://db/valerie")
    monkeypatch.setenv("VALERIE_MAX_VARIANTS", "12")
    settings = load_settings()
    assert settings.database_url == "postgresql://db/valerie"
    assert settings.max_variants == 12


def test_an_override_wins_over_the_environment_and_none_does_not(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("VALERIE_API_PORT", "9000")
    assert load_settings(api_port=9001).api_port == 9001
    assert load_settings(api_port=None).api_port == 9000


def test_an_empty_variable_is_as_good_as_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("VALERIE_API_TOKEN", "")
    monkeypatch.setenv("VALERIE_DATABASE_URL", "")
    settings = load_settings()
    assert settings.api_token is None
    assert settings.database_url.startswith("sqlite:///")


def test_a_misspelt_variable_is_refused_with_the_right_name(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("VALERIE_API_PROT", "9000")
    with pytest.raises(UnknownName, match="VALERIE_API_PORT"):
        load_settings()


def test_variables_of_setup_and_tests_are_none_of_our_business(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("VALERIE_SETUP_PIP_OPTIONS", "--quiet")
    monkeypatch.setenv("VALERIE_TEST_DATABASE_URL", "sqlite://")
    load_settings()


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("VALERIE_API_PORT", "65536"),
        ("VALERIE_API_PORT", "many"),
        ("VALERIE_LEASE_SECONDS", "nan"),
        ("VALERIE_LEASE_SECONDS", "inf"),
        ("VALERIE_SWEEP_SECONDS", "0"),
        ("VALERIE_MAX_VARIANTS", "-1"),
        ("VALERIE_LOG_LEVEL", "loud"),
    ],
)
def test_a_bad_value_is_refused_by_the_name_of_its_variable(
    name: str, value: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(name, value)
    with pytest.raises(InvalidInput, match=f"{name}.*{value}"):
        load_settings()


def test_all_bad_values_are_reported_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("VALERIE_API_PORT", "x")
    monkeypatch.setenv("VALERIE_MAX_VARIANTS", "y")
    with pytest.raises(InvalidInput, match=r"VALERIE_API_PORT(.|\n)*VALERIE_MAX_VARIANTS"):
        load_settings()


def test_heartbeats_must_be_faster_than_leases(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("VALERIE_LEASE_SECONDS", "10")
    with pytest.raises(InvalidInput, match="VALERIE_HEARTBEAT_SECONDS 5"):
        load_settings()


def test_another_process_builds_equal_settings_from_the_environment_that_is_handed_on(tmp_path: Path) -> None:
    settings = load_settings(
        data_dir=tmp_path, api_token="a secret of some length", api_port=0, asset_dir=tmp_path, lease_seconds=33.5
    )
    program = "from valerie.settings import load_settings; print(load_settings().environment())"
    environment = {"PATH": os.environ["PATH"], **settings.environment()}
    other = subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True, cwd=Path.cwd()
    )
    assert other.stdout.strip() == str(settings.environment())


def test_the_token_is_not_shown() -> None:
    assert "opensesame" not in repr(load_settings(api_token="opensesame-opensesame"))


def test_settings_cannot_be_changed() -> None:
    with pytest.raises(ValidationError, match="frozen"):
        load_settings().api_port = 1  # type: ignore[misc]


@pytest.mark.parametrize("host", ["127.0.0.1", "::1", "localhost"])
def test_loopback_needs_no_token(host: str) -> None:
    load_settings(api_host=host).require_token()


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "192.168.1.4", "valerie.example.org"])
def test_another_address_needs_a_token(host: str) -> None:
    with pytest.raises(InvalidInput, match="VALERIE_API_TOKEN"):
        load_settings(api_host=host).require_token()


def test_a_short_token_guards_nothing() -> None:
    with pytest.raises(InvalidInput, match="16 characters"):
        load_settings(api_host="0.0.0.0", api_token="short").require_token()


def test_a_token_opens_other_addresses() -> None:
    load_settings(api_host="0.0.0.0", api_token="0123456789abcdef").require_token()


def test_every_setting_is_described() -> None:
    undescribed = [name for name, field in Settings.model_fields.items() if not field.description]
    assert set(undescribed) <= {"log_level", "log_format"}
