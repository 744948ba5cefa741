"""Find the server for a command, or start one that ends with the command."""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from valerie.cli.shell import say
from valerie.client import Client, ServerProblemError, ServerUnavailableError
from valerie.embedded import running
from valerie.errors import InvalidInput
from valerie.local.deployment import context_of, settings_of
from valerie.local.folder import Folder
from valerie.local.terminal import command_name
from valerie.settings import Settings

if TYPE_CHECKING:
    from valerie.embedded.supervisor import Supervisor


@dataclass(frozen=True, slots=True)
class System:
    """A running server.

    Attributes:
        client: client of the server.
        owned: True if this command started the server and will end it.
        check: raises if a process of an owned system keeps ending.
        supervisor: supervisor of an owned system.
    """

    client: Client
    owned: bool
    check: Callable[[], None]
    supervisor: Supervisor | None = None


def client_of(settings: Settings, url: str | None = None) -> Client:
    """Return a client of the server at ``url``, else on the data folder, else at the configured address.

    Raises:
        ServerUnavailableError: the user named a data folder, and no server runs on it.
    """
    if url is None:
        server = running.find(settings.data_dir)
        explicit = settings.model_fields_set
        of_folder = "data_dir" in explicit and explicit.isdisjoint(("api_host", "api_port"))
        if server is None and (of_folder or settings.api_port == 0):
            # The server at the configured address may belong to another folder.
            folder = settings.data_dir
            problem = f"on the data folder {folder}" if folder.exists() else f"on {folder}, which does not exist"
            raise ServerUnavailableError(
                f"no server runs {problem}; start one with `{_up(settings)}`, or name another with --url"
            )
        url = server.url if server is not None else f"http://{settings.api_host}:{settings.api_port}"
    return Client(url, token=_token(settings))


def client_at(url: str | None, data_dir: Path | None) -> Client:
    """Return the client of a command with these options; see `client_of`."""
    return client_of(settings_of(data_dir), url)


@contextmanager
def source_of(data_dir: Path | None, url: str | None) -> Iterator[Client | Folder]:
    """Open the server at ``url`` or on the data folder, to read runs and studies; without a server, open the folder.

    Raises:
        NotFound: no server runs, and the data folder has no database.
        ValerieError: the database is of another version.
    """
    settings = settings_of(data_dir)
    configured = settings.api_port != 0 and not settings.model_fields_set.isdisjoint(("api_host", "api_port"))
    if url is None and not configured and running.find(settings.data_dir) is None:
        with context_of(data_dir) as context:
            yield Folder(context, up=_up(settings))
        return
    with client_of(settings, url) as client:
        yield client


@contextmanager
def system_of(settings: Settings) -> Iterator[System]:
    """Open the system that runs on the data folder; if there is none, start one and end it afterwards.

    Raises:
        ValerieError: the system cannot be started.
    """
    server = running.acquire(settings.data_dir)
    if isinstance(server, running.Running):
        say(f"using the server at {server.url} (process {server.pid}), with the settings of its start")
        with Client(server.url, token=_token(settings)) as client:
            yield System(client, owned=False, check=lambda: None)
        return
    say(f"starting Redis, the API and the workers (logs: {settings.data_dir / 'logs'})")
    from valerie.embedded.supervisor import Supervisor  # commands that only query a server need no Redis

    with Supervisor(settings, server) as supervisor, Client(supervisor.url, token=_token(settings)) as client:
        if settings.api_port not in (0, supervisor.settings.api_port):
            say(f"port {settings.api_port} is in use; this server listens at {supervisor.url}")
        yield System(client, owned=True, check=supervisor.check, supervisor=supervisor)


@contextmanager
def own_assets(settings: Settings, client: Client) -> Iterator[None]:
    """Explain why a server does not know an asset of the caller's own folder.

    Raises:
        InvalidInput: the server refused such an asset.
    """
    from valerie.scene.assets.asset import asset_names

    try:
        yield
    except ServerProblemError as error:
        refused = re.match(r"asset: unknown asset '([^']+)'", error.detail)
        if refused is None or refused[1] not in asset_names(settings.asset_dir):
            raise
        raise InvalidInput(
            f"the server at {client.url} does not know this asset: it reads the folder that VALERIE_ASSET_DIR named when "
            f"it was started, and the asset is in {settings.asset_dir}; restart the server with that folder",
            field="asset",
            value=refused[1],
        ) from error


def _up(settings: Settings) -> str:
    """Return the command line that starts a server on the data folder."""
    explicit = "data_dir" in settings.model_fields_set
    options = f" --data-dir {shlex.quote(str(settings.data_dir))}" if explicit else ""
    return f"{command_name()} up{options}"


def _token(settings: Settings) -> str | None:
    return settings.api_token.get_secret_value() if settings.api_token else None
