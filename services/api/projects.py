"""What exists for a token of one project: its runs, with their frames and products, and its studies."""

from __future__ import annotations

from collections.abc import Iterator

from fastapi import Request

from services.api.dependencies import ContextDependency, ProjectDependency
from valerie.db import links, runs, studies
from valerie.db.engine import reading
from valerie.errors import NotFound

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
            runs.require(connection, run_id, project=project)
        if "study_id" in path:
            studies.require(connection, path["study_id"], project=project)
        by_inputs = "digest" in path and path["kind"] not in _BY_CONTENT
        if by_inputs and not links.has_product(connection, path["digest"], project=project):
            raise NotFound(path["kind"], path["digest"])


def _runs(request: Request) -> Iterator[str]:
    """Yield the ids of the runs that a request names; those of frames and thumbnails begin with that of their run."""
    path, query = request.path_params, request.query_params
    if "run_id" in path:
        yield path["run_id"]
    if "frame_id" in path:
        yield path["frame_id"].partition(".")[0]
    yield from query.getlist("run")
    yield from {tile.partition(".")[0] for tile in query.getlist("tile")}
