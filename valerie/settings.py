"""The settings of a deployment: environment variables ``VALERIE_*``, read once when a process starts.

Each entry point builds one frozen `Settings` with `load_settings` and passes it down; there is no global. A process
passes its settings to its children as environment variables (`Settings.environment`).
"""

from __future__ import annotations

import base64
import os
import re
from collections.abc import Mapping
from ipaddress import ip_network
from pathlib import Path
from typing import Annotated, Any, Final, Literal, Self

from pydantic import Field, SecretStr, ValidationError, model_validator
from pydantic_core import ErrorDetails
from pydantic_settings import BaseSettings, SettingsConfigDict

from valerie.access import PROJECT, Role
from valerie.addresses import Allowed, parse_allowed, parse_url
from valerie.errors import InvalidInput, InvalidInputs, UnknownName
from valerie.spelling import package_name
from valerie.validation import problem_of

PREFIX: Final = "VALERIE_"
#: ``broker_url`` of a deployment whose workers ask the database (`valerie.pipeline.work.asking`).
NO_BROKER: Final = "none"
#: Variables that belong to set-up and tests, not to a running process.
_FOREIGN: Final = ("VALERIE_SETUP_", "VALERIE_TEST_")
#: Of the key that signs webhooks, bytes; the least of Standard Webhooks.
_SHORTEST_KEY: Final = 24
#: Names of this machine.
LOOPBACK: Final = ("127.0.0.1", "::1", "localhost")

Seconds = Annotated[float, Field(gt=0, le=86_400, allow_inf_nan=False)]


class Settings(BaseSettings):
    """The settings of a deployment. Every field is an environment variable ``VALERIE_<FIELD>``."""

    model_config = SettingsConfigDict(env_prefix=PREFIX, frozen=True, extra="forbid", env_ignore_empty=True)

    # Storage
    data_dir: Path = Field(Path("var/valerie"), description="database, artifacts, logs and sockets of this machine")
    database_url: str = Field("", description="sqlite:///path or postgresql://…; empty: a SQLite file in data_dir")
    database_seconds: float = Field(
        120.0,
        ge=2,
        le=86_400,
        allow_inf_nan=False,
        description="longest time of a statement on Postgres",
    )
    artifacts_url: str = Field(
        "", description="a folder, or s3://bucket/prefix; empty: the folder artifacts in data_dir"
    )
    s3_endpoint: str | None = Field(None, description="URL of an S3-compatible server other than AWS")
    asset_dir: Path = Field(Path(), description="folder of your own assets; empty: the folder assets in data_dir")
    min_free_mb: int = Field(200, ge=0, description="free space of the artifact folder below which runs pause, MiB")

    # Broker
    broker_url: str = Field(
        "redis://127.0.0.1:6379/0",
        description="Redis, Valkey or RabbitMQ (amqp://…) of the queues; unless set, the one-machine mode starts its own; "
        "none: all workers ask the database (worker_idle_seconds)",
    )
    redis_server: Path | None = Field(
        None, description="redis-server program of the one-machine mode; empty: search for one"
    )
    visibility_timeout_seconds: int = Field(
        3600, ge=5, description="time after which an unacknowledged message is delivered again; longer than any task"
    )

    # API
    api_host: str = Field(
        "127.0.0.1", min_length=1, description="address to listen on; any other than loopback needs api_token"
    )
    api_port: int = Field(8700, ge=0, le=65_535, description="port to listen on; 0: any free one")
    api_token: SecretStr | None = Field(
        None, description="the operator's bearer token; with it, every request needs a token"
    )
    oidc_issuer: str = Field(
        "", description="OpenID provider whose users may sign in, as https://id.example; empty: none"
    )
    oidc_client: str = Field(
        "", description="the provider's name for this server: its client id, and audience of its tokens"
    )
    oidc_secret: SecretStr | None = Field(None, description="the client's secret, if the provider gave one")
    oidc_owner: str = Field("sub", min_length=1, description="claim that names a user, once and for ever")
    oidc_project: str = Field("", description="claim that names a user's project; empty: users have none, and see all")
    oidc_groups: str = Field("groups", min_length=1, description="claim with a user's groups")
    oidc_roles: str = Field("", description="roles of groups, as validators=runner,leads=admin,*=viewer; *: everybody")
    oidc_hours: float = Field(12.0, gt=0, le=720, allow_inf_nan=False, description="time until somebody signs in again")
    requests_per_minute: int = Field(
        0, ge=0, description="requests of a token, or of an address without one; then 429; 0: no limit"
    )
    trusted_proxies: str = Field(
        "",
        description="addresses of proxies whose X-Forwarded-For and X-Forwarded-Proto count, as 10.0.0.2,10.1.0.0/16; "
        "empty: none",
    )
    max_body_bytes: int = Field(2_000_000, ge=1_000, description="longest request body")
    body_seconds: Seconds = Field(
        60.0, description="time for a request body to arrive; for each part where it is a file"
    )
    unread_seconds: Seconds = Field(
        30.0, description="time in which a client must take 16 KiB of an answer, or lose the connection"
    )

    # Functions under test
    max_function_mb: int = Field(
        1_024, ge=1, le=8_192, description="largest file of a function; checked before it is read"
    )
    import_memory_mb: int = Field(
        8_192, ge=0, description="private memory of the process that converts and checks a function; 0: no limit"
    )
    import_seconds: Seconds = Field(600.0, description="time limit of converting and checking")
    import_programs: bool = Field(
        False, description="also accept programs of torch (.pt2, .torchscript), which execute their author's code"
    )
    function_cache_mb: int = Field(4_096, ge=1, description="function files that a machine keeps in data_dir")
    archive_cache_mb: int = Field(4_096, ge=1, description="rows of archived runs that a machine keeps in data_dir")
    predictions_hours: float = Field(
        168.0, gt=0, le=87_600, allow_inf_nan=False, description="time that a run waits for uploaded predictions"
    )

    # Webhooks
    webhooks: str = Field(
        "", description="URLs that are told of each ended run, as https://ci.example/valerie,…; empty: none"
    )
    webhook_secret: SecretStr | None = Field(
        None, description="secret that signs webhooks, at least 24 bytes in base64, as of `openssl rand -base64 32`"
    )
    webhook_networks: str = Field(
        "", description="private addresses that webhooks may lead to, as 10.1.0.0/16,ci.internal:8000; empty: none"
    )

    # Traces
    traces_url: str = Field(
        "", description="OTLP/HTTP address that traces are sent to, as http://127.0.0.1:4318/v1/traces; empty: none"
    )
    traces_share: float = Field(1.0, ge=0, le=1, allow_inf_nan=False, description="share of the frames that are traced")

    # Plug-ins
    plugins: str = Field(
        "",
        description="installed packages whose engines, functions and samplers may be used, as my-package,other; "
        "they run with VALERIE's rights; empty: none",
    )

    # Runs
    max_variants: int = Field(1_000_000, ge=1, description="largest run")
    max_owner_runs: int = Field(0, ge=0, description="unfinished runs of a token's owner; 0: no limit")
    max_owner_variants: int = Field(
        0, ge=0, description="variants in the unfinished runs of a token's owner; 0: no limit"
    )
    max_project_runs: int = Field(0, ge=0, description="unfinished runs of a project; 0: no limit")
    max_project_variants: int = Field(0, ge=0, description="variants in the unfinished runs of a project; 0: no limit")
    max_owner_cpu_hours: float = Field(
        0, ge=0, description="CPU hours that an owner's runs took in 30 days; 0: no limit"
    )
    max_owner_gigabytes: float = Field(0, ge=0, description="stored products of an owner's runs; 0: no limit")
    max_project_cpu_hours: float = Field(
        0, ge=0, description="CPU hours that a project's runs took in 30 days; 0: no limit"
    )
    max_project_gigabytes: float = Field(0, ge=0, description="stored products of a project's runs; 0: no limit")
    tenants: str = Field(
        "", description="projects that share products under one name, as radar=adas,camera=adas; others share with none"
    )
    feed_window: int = Field(4_000, ge=1, description="unfinished products written ahead of the workers")
    sweep_seconds: Seconds = Field(2.0, description="pause between two sweeps of the control loop")
    resend_seconds: Seconds = Field(
        20.0, description="time after which the message for a ready, unclaimed product is sent again"
    )
    max_attempts: int = Field(4, ge=1, le=100, description="attempts of a product before it fails for good")

    # Workers
    lease_seconds: Seconds = Field(60.0, description="time after which the product of a silent worker is taken back")
    heartbeat_seconds: Seconds = Field(5.0, description="pause between two heartbeats; at most a third of the lease")
    shutdown_seconds: Seconds = Field(5.0, description="time that a worker has to stop")
    worker_idle_seconds: float | None = Field(
        None,
        ge=0,
        le=86_400,
        allow_inf_nan=False,
        description="time without work after which a worker ends; with it, a worker asks the database instead of the broker",
    )
    worker_max_tasks: int | None = Field(None, ge=1, description="messages after which a worker process is replaced")
    worker_max_memory_mb: int = Field(4_096, ge=256, description="memory above which a worker process is replaced")
    render_engines: str = Field(
        "raster,pyrender,cycles", description="engines that a render worker offers if they work on its machine"
    )
    infer_functions: str = Field("", description="functions that an inference worker offers; empty: all")
    cycles_python: Path = Field(
        Path(".venv-cycles/bin/python"), description="Python of the environment with Blender (`make cycles`)"
    )
    cycles_device: Literal["auto", "cpu", "cuda", "optix", "hip", "oneapi", "metal"] = Field(
        "auto", description="device of Cycles; auto: a graphics card if there is one"
    )
    cycles_threads: int = Field(0, ge=0, le=1024, description="threads of Cycles; 0: one per core of the machine")
    cycles_silence_seconds: Seconds = Field(300.0, description="time without progress after which Blender is ended")
    cycles_max_memory_mb: int = Field(8_192, ge=512, description="memory above which Blender is ended")
    infer_engines: str = Field(
        "",
        description="engines for registered functions that an inference worker offers, as torch/fp32,openvino/bf16; "
        "empty: all that work on its machine; none: no registered functions",
    )
    infer_device: str = Field(
        "auto", pattern=r"^(auto|cpu|cuda(:[0-9]+)?)$", description="device of torch: auto, cpu, cuda, cuda:1"
    )
    infer_precision: Literal["auto", "fp32", "bf16"] = Field(
        "auto",
        description="precision of the shipped functions; auto: bf16 where the processor multiplies it, else fp32",
    )
    infer_memory_mb: int = Field(
        16_384,
        ge=0,
        description="private memory of the process that runs a function; larger allocations fail; 0: no limit",
    )
    infer_seconds: float = Field(
        600.0,
        ge=0,
        le=86_400,
        allow_inf_nan=False,
        description="longest time to open a function, and for one picture; 0: no limit",
    )
    http_functions: str = Field(
        "", description="permitted addresses of functions behind HTTP, as models.example:8000,10.1.0.0/16; empty: none"
    )
    testing_engines: bool = Field(False, description="accept the blank engine and function of benchmarks and tests")
    infer_threads: int = Field(0, ge=0, description="threads of the inference engine; 0: one per core of the machine")

    # Logs
    log_level: Literal["debug", "info", "warning", "error"] = "info"
    log_format: Literal["text", "json"] = "text"

    @model_validator(mode="before")
    @classmethod
    def _derived(cls, values: Any) -> Any:
        """Make paths absolute, since children may run in another folder, and derive missing ones from ``data_dir``."""
        data_dir = Path(values.get("data_dir") or cls.model_fields["data_dir"].default).expanduser().absolute()
        values = {**values, "data_dir": data_dir}
        if not values.get("database_url"):
            values["database_url"] = f"sqlite:///{data_dir / 'valerie.sqlite3'}"
        if not values.get("artifacts_url"):
            values["artifacts_url"] = str(data_dir / "artifacts")
        python = Path(values.get("cycles_python") or cls.model_fields["cycles_python"].default)
        values["cycles_python"] = python.expanduser().absolute()
        values["asset_dir"] = Path(values.get("asset_dir") or data_dir / "assets").expanduser().absolute()
        return values

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if self.heartbeat_seconds * 3 > self.lease_seconds:
            raise ValueError(
                f"VALERIE_HEARTBEAT_SECONDS {self.heartbeat_seconds:g} must be at most a third of "
                f"VALERIE_LEASE_SECONDS {self.lease_seconds:g}: a lease must outlive two lost heartbeats"
            )
        return self

    @model_validator(mode="after")
    def _usable_webhooks(self) -> Self:
        for url in self.webhook_urls:
            parse_url(url, field="VALERIE_WEBHOOKS")
        _ = self.webhook_hosts
        if self.webhook_urls and len(self.webhook_key) < _SHORTEST_KEY:
            raise InvalidInput(
                "webhooks are signed with a secret",
                field="VALERIE_WEBHOOK_SECRET",
                limit=f"at least {_SHORTEST_KEY} bytes in base64; `openssl rand -base64 32` makes one",
            )
        return self

    @model_validator(mode="after")
    def _usable_proxies(self) -> Self:
        for entry in self.proxies:
            try:
                ip_network(entry)
            except ValueError:
                raise InvalidInput(
                    "not an address or a network",
                    field="VALERIE_TRUSTED_PROXIES",
                    value=entry,
                    limit="10.0.0.2, 10.1.0.0/16, fd00::2",
                ) from None
        return self

    @model_validator(mode="after")
    def _usable_tenants(self) -> Self:
        _ = self._tenants
        return self

    @model_validator(mode="after")
    def _usable_sign_in(self) -> Self:
        if not self.oidc_issuer:
            return self
        host, *_, secure = parse_url(self.oidc_issuer, field="VALERIE_OIDC_ISSUER")
        if not secure and host not in LOOPBACK:
            raise InvalidInput("not an https URL", field="VALERIE_OIDC_ISSUER", value=self.oidc_issuer)
        if not self.oidc_role_of_group:
            raise InvalidInput(
                "nobody would have a role", field="VALERIE_OIDC_ROLES", limit="validators=runner,*=viewer"
            )
        for field, value in (("VALERIE_OIDC_CLIENT", self.oidc_client), ("VALERIE_API_TOKEN", self.api_token)):
            if not value:
                raise InvalidInput("sign-in needs it", field=field)
        return self

    @model_validator(mode="after")
    def _usable_traces(self) -> Self:
        if self.traces_url:
            parse_url(self.traces_url, field="VALERIE_TRACES_URL")
        return self

    @property
    def inference_threads(self) -> int:
        """Threads of an inference worker. They are part of the numeric class, since the last bits of sums depend on them."""
        return self.infer_threads or os.cpu_count() or 1

    @property
    def http_addresses(self) -> tuple[str, ...]:
        """The entries of ``http_functions``."""
        return _entries(self.http_functions)

    @property
    def proxies(self) -> tuple[str, ...]:
        """The entries of ``trusted_proxies``."""
        return _entries(self.trusted_proxies)

    @property
    def webhook_urls(self) -> tuple[str, ...]:
        """The entries of ``webhooks``."""
        return _entries(self.webhooks)

    @property
    def webhook_hosts(self) -> tuple[Allowed, ...]:
        """The entries of ``webhook_networks``."""
        return parse_allowed(_entries(self.webhook_networks), field="VALERIE_WEBHOOK_NETWORKS")

    @property
    def webhook_key(self) -> bytes:
        """The bytes of ``webhook_secret``, which may begin with ``whsec_``; empty if it is missing or not base64."""
        text = self.webhook_secret.get_secret_value() if self.webhook_secret else ""
        try:
            return base64.b64decode(text.removeprefix("whsec_"), validate=True)
        except ValueError:
            return b""

    def tenant_of(self, project: str) -> str:
        """Return the tenant of a project: the name under which it shares products, by default its own; empty for none."""
        return self._tenants.get(project, project)

    @property
    def _tenants(self) -> dict[str, str]:
        """The entries of ``tenants``."""
        pairs = [entry.partition("=") for entry in _entries(self.tenants)]
        for project, _, tenant in pairs:
            if not re.fullmatch(PROJECT, project) or not re.fullmatch(PROJECT, tenant):
                raise InvalidInput(
                    "not a project and its tenant",
                    field="VALERIE_TENANTS",
                    value=f"{project}={tenant}",
                    limit="PROJECT=TENANT, in small letters, digits, '.', '_' and '-'",
                )
        return {project: tenant for project, _, tenant in pairs}

    @property
    def oidc_role_of_group(self) -> dict[str, Role]:
        """The entries of ``oidc_roles``."""
        pairs = [entry.rpartition("=") for entry in _entries(self.oidc_roles)]
        for group, _, role in pairs:
            if not group or role not in set(Role):
                limit = f"GROUP=ROLE; roles: {', '.join(Role)}"
                raise InvalidInput(
                    "not a role of a group", field="VALERIE_OIDC_ROLES", value=f"{group}={role}", limit=limit
                )
        return {group: Role(role) for group, _, role in pairs}

    @property
    def plugin_packages(self) -> tuple[str, ...]:
        """The packages in ``plugins``, as normalized names."""
        return tuple(package_name(entry) for entry in _entries(self.plugins))

    @property
    def exposed(self) -> bool:
        """True if the API accepts requests from other machines."""
        return self.api_host not in LOOPBACK

    def require_token(self) -> None:
        """Check that an API for other machines has a token.

        Raises:
            InvalidInput: the address is not loopback, and the token is missing or too short.
        """
        token = self.api_token.get_secret_value() if self.api_token else ""
        if self.exposed and not token:
            raise InvalidInput(
                "the API would be open to the network without a token",
                field="VALERIE_API_TOKEN",
                limit=f"a token, or VALERIE_API_HOST={LOOPBACK[0]} instead of {self.api_host}",
            )
        if self.exposed and len(token) < 16:
            raise InvalidInput("the token is too short", field="VALERIE_API_TOKEN", limit="at least 16 characters")

    def environment(self) -> dict[str, str]:
        """Return the environment variables from which another process builds equal settings."""
        variables: dict[str, str] = {}
        for name in type(self).model_fields:
            value = getattr(self, name)
            if value is not None:
                text = value.get_secret_value() if isinstance(value, SecretStr) else str(value)
                variables[PREFIX + name.upper()] = text
        return variables


def load_settings(environ: Mapping[str, str] | None = None, **overrides: object) -> Settings:
    """Read the settings from the environment of this process.

    Args:
        environ: variables to check for unknown names, by default ``os.environ``. The values always come from ``os.environ``.
        overrides: fields that override the environment; None overrides nothing.

    Raises:
        UnknownName: a variable begins with ``VALERIE_`` and is not a setting.
        InvalidInputs: values are invalid. Each problem names its variable.
    """
    names = {PREFIX + name.upper() for name in Settings.model_fields}
    for name in sorted(environ if environ is not None else os.environ):
        if name.startswith(PREFIX) and not name.startswith(_FOREIGN) and name.upper() not in names:
            raise UnknownName("setting", name, names)
    fields = {name: value for name, value in overrides.items() if value is not None}
    try:
        return Settings(**fields)  # type: ignore[arg-type]  # pydantic checks them
    except ValidationError as error:
        raise InvalidInputs([_problem(detail) for detail in error.errors(include_url=False)]) from None


def _entries(text: str) -> tuple[str, ...]:
    return tuple(entry.strip() for entry in text.split(",") if entry.strip())


def _problem(detail: ErrorDetails) -> InvalidInput:
    place = ".".join(str(part) for part in detail["loc"])
    field = PREFIX + place.upper() if place else ""
    if place in ("", "api_token", "webhook_secret", "oidc_secret"):  # secret
        detail = detail.copy()
        detail["input"] = None
    return problem_of(detail, field)
