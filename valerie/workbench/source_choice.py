"""Find out who answers: a server, or the data folder itself."""

from __future__ import annotations

from pathlib import Path

from valerie.client import Client
from valerie.embedded import running
from valerie.errors import NotFound
from valerie.local.deployment import has_database, open_current
from valerie.settings import load_settings
from valerie.workbench.sources import RunSource, Served, StoredRuns


def open_source(place: str | Path | None, token: str | None) -> RunSource:
    """Open a source; see `valerie.connect`.

    Raises:
        NotFound: the folder has no runs.
        ValerieError: the database is of another version.
    """
    if isinstance(place, str) and place.startswith(("http://", "https://")):
        return Served(_client(place, token))
    settings = load_settings(data_dir=None if place is None else Path(place))
    server = running.find(settings.data_dir)
    if server is not None:
        return Served(_client(server.url, token))
    up = f"valerie up --data-dir {settings.data_dir}"
    if not has_database(settings):
        raise NotFound("database", f"{settings.data_dir}: `{up}` creates one")
    return StoredRuns(open_current(settings), up)


def _client(url: str, token: str | None) -> Client:
    configured = load_settings().api_token
    return Client(url, token=token or (configured.get_secret_value() if configured else None))
