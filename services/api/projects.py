"""What exists for a token of one project: its runs, with their frames and products, and its studies."""

from __future__ import annotations

import re
from collections.abc import Iterator

from fastapi import Request

from services.api.dependencies import ContextDependency, ProjectDependency
from valerie.db import links, runs, studies
from valerie.db.engine import reading
from valerie.errors import NotFound
from valerie.runs.products.frame_keys import ID

#: Kinds of stored objects that are named by a digest of their content, which only someone who has them knows.
_BY_CONTENT = frozenset({"statics"})


def require_own(request: Request, project: ProjectDependency, context: ContextDependency) -> None:
    """Treat runs, frames, studies and products of other projects as if they did not exist.

    Path and query name them. Bodies, lists and selections are the endpoints' own business.

    Raises:
        NotFound: as for what does not exist.
    """
    if not project:
        return
    path = request.path_params
    with reading(context.engine) as connection:
        for run_id in _runs(request):
            runs.require(connection, _usable("run", run_id), project=project)
        if "study_id" in path:
            studies.require(connection, _usable("study", path["study_id"]), project=project)
        if "digest" in path and path["kind"] not in _BY_CONTENT:
            kind, product = path["kind"], path["digest"]
            if not links.has_product(connection, _usable(kind, product), project=project):
                raise NotFound(kind, product)


def _usable(what: str, name: str) -> str:
    """Return an id or a digest that a query can look for; the endpoint's own check of its form comes later."""
    if not re.fullmatch(ID, name):
        raise NotFound(what, name)
    return name


def _runs(request: Request) -> Iterator[str]:
    """Yield the ids of the runs that a request names; those of frames and thumbnails begin with that of their run."""
    path, query = request.path_params, request.query_params
    if "run_id" in path:
        yield path["run_id"]
    if "frame_id" in path:
        yield path["frame_id"].partition(".")[0]
    yield from query.getlist("run")
    yield from {tile.partition(".")[0] for tile in query.getlist("tile")}
