"""Finding the server that a command talks to, or starting one for as long as the command runs."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from valerie.cli.shell import command_name, say
from valerie.client import Client, ServerUnavailableError
from valerie.embedded import running
from valerie.embedded.supervisor import Supervisor
from valerie.settings import Settings


@dataclass(frozen=True, slots=True)
class System:
    """A server that answers.

    Attributes:
        client: to talk to it.
        owned: whether it ends with this command.
        check: raises when a process of an owned system was given up.
        supervisor: of an owned system.
    """

    client: Client
    owned: bool
    check: Callable[[], None]
    supervisor: Supervisor | None = None


def client_of(settings: Settings, url: str | None = None) -> Client:
    """A client of the named server, else of the one that runs on the data folder, else of the configured address.

    Raises:
        ServerUnavailableError: a data folder was named on which none runs; another folder's server is not asked.
    """
    if url is None:
        found = running.find(settings.data_dir)
        given = settings.model_fields_set
        if found is None and "data_dir" in given and given.isdisjoint(("api_host", "api_port")):
            start = f"{command_name()} up --data-dir {shlex.quote(str(settings.data_dir))}"
            raise ServerUnavailableError(
                f"no server runs on the data folder {settings.data_dir}; start one with `{start}`, "
                "or name another with --url"
            )
        url = found.url if found is not None else f"http://{settings.api_host}:{settings.api_port}"
    return Client(url, token=_token(settings))


@contextmanager
def system_of(settings: Settings) -> Iterator[System]:
    """The system that runs on the data folder; one is started, and ended again, if there is none.

    Raises:
        ValerieError: it cannot be started; says why.
    """
    found = running.acquire(settings.data_dir)
    if isinstance(found, running.Running):
        say(f"using the server that runs at {found.url} (process {found.pid})")
        with Client(found.url, token=_token(settings)) as client:
            yield System(client, owned=False, check=lambda: None)
        return
    say(f"starting Redis, the API and the workers (logs: {settings.data_dir / 'logs'})")
    with Supervisor(settings, found) as supervisor, Client(supervisor.url, token=_token(settings)) as client:
        yield System(client, owned=True, check=supervisor.check, supervisor=supervisor)


def _token(settings: Settings) -> str | None:
    return settings.api_token.get_secret_value() if settings.api_token else None
