"""What a deployment shows of its runs, and the rows of its database, to be compared before and after runs are archived."""

from __future__ import annotations

import io
from collections.abc import Iterator
from itertools import product
from typing import Any
from zipfile import ZipFile

import httpx
from sqlalchemy import Engine, MetaData, func, select

from valerie.db.engine import reading

#: Tables with rows of runs that leave the database.
LEAVING = (
    "blocks",
    "variants",
    "frames",
    "evaluations",
    "frame_annotations",
    "products",
    "person_views",
    "person_lights",
    "pictures",
    "scores",
    "person_scores",
)
#: Values of path and query parameters, besides ids and names.
_VALUES: dict[str, list[Any]] = {
    "kind": [
        "background", "layer", "truth", "prediction", "normals", "light", "boxes",
        "picture", "overlay", "errors", "depth", "instances",
    ],
    "column": ["pacc", "distance_m"],
    "x": [48],
    "y": [27],
    "format": ["csv", "parquet"],
}  # fmt: skip


def rows_of(engine: Engine) -> dict[str, list[tuple[Any, ...]]]:
    """Return all rows of a database by table, in an order of their own."""
    metadata = MetaData()
    metadata.reflect(engine)
    with reading(engine) as connection:
        return {
            name: sorted((tuple(row) for row in connection.execute(select(table))), key=repr)
            for name, table in metadata.tables.items()
        }


def counts_of(engine: Engine) -> dict[str, int]:
    """Return the number of rows of each table of `LEAVING`."""
    metadata = MetaData()
    metadata.reflect(engine)
    with reading(engine) as connection:
        tables = {name: metadata.tables[name] for name in LEAVING}
        return {name: connection.scalar(select(func.count()).select_from(table)) or 0 for name, table in tables.items()}


def answers(api: httpx.Client, runs: list[str]) -> dict[str, tuple[int, str, Any]]:
    """Return address to status, media type and content of everything that the API shows of runs: of every GET route.

    Whether a run is archived is left out, as are times of reading.
    """
    found: dict[str, tuple[int, str, Any]] = {}
    for address in _addresses(api, runs):
        answer = api.get(address)
        media = answer.headers.get("content-type", "")
        content: Any = answer.content
        if media.endswith("json"):
            content = _lasting(answer.json())
        elif media.endswith("zip"):
            with ZipFile(io.BytesIO(content)) as archive:
                content = {name: archive.read(name) for name in archive.namelist()}
        found[address] = answer.status_code, media, content
    return found


def _addresses(api: httpx.Client, runs: list[str]) -> Iterator[str]:
    ids = {run: _ids(api, run) for run in runs}
    for path, item in api.get("/openapi.json").json()["paths"].items():
        names = {one["name"]: one for one in item.get("get", {}).get("parameters", [])}
        if path in ("/v1/runs", "/v1/tags"):
            yield path
        if not names.keys() & {"run_id", "frame_id", "digest", "run", "tile"}:
            continue
        asked = [name for name, one in names.items() if one["required"] or name in ("kind", "format")]
        for run in runs:
            for chosen in product(*(ids[run][name] for name in asked)):
                pairs = dict(zip(asked, chosen, strict=True))
                query = {name: value for name, value in pairs.items() if f"{{{name}}}" not in path}
                yield str(httpx.URL(path.format(**pairs), params=query))
                if "run" in query and names["run"]["schema"]["type"] == "array":
                    yield str(httpx.URL(path.format(**pairs), params={**query, "run": runs}))


def _ids(api: httpx.Client, run: str) -> dict[str, list[Any]]:
    """Return parameter to values that concern a run; a new required parameter needs an entry."""
    items = api.get(f"/v1/runs/{run}/frames", params={"limit": 1000}).json()["items"]
    chosen = {one["state"]: one["id"] for one in items} | {"first": items[0]["id"]}
    some = [api.get(f"/v1/frames/{frame}").json() for frame in chosen.values()]
    functions = api.get(f"/v1/runs/{run}").json()["spec"]["functions"]
    digests = {one[name] for one in some for name in ("background", "layer", "truth")}
    digests |= {evaluation["prediction"] for one in some for evaluation in one["evaluations"]}
    digests |= {digest for one in some for digest in one["annotations"].values()}
    persons = [(one["id"], person["instance_id"]) for one in some for person in one["persons"]]
    return {
        "run_id": [run],
        "run": [run],
        "frame_id": [one["id"] for one in some],
        "digest": sorted(digests),
        "tile": [f"{frame}:{person}:{functions[0]}:default" for frame, person in persons],
        "before": [f"{run}:{functions[0]}"],
        "after": [f"{run}:{functions[-1]}"],
        "function": functions,
        **_VALUES,
    }


def _lasting(document: Any) -> Any:
    if isinstance(document, dict):
        return {name: _lasting(value) for name, value in document.items() if name not in ("archived", "read_at")}
    return [_lasting(value) for value in document] if isinstance(document, list) else document
