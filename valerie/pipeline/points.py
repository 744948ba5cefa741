"""Points of a scatter plot: pACC over one column of the long table, as columns of plain lists."""

from __future__ import annotations

from collections import Counter
from typing import Any, Final

from valerie.db import results, runs
from valerie.db.engine import reading
from valerie.pipeline.context import Context
from valerie.pipeline.resolution import resolve_stored
from valerie.pipeline.tables import character_of

#: What pACC is plotted over.
PLOTTED: Final = ("distance_m", "occlusion_rate", "pixel_area", "pixel_area_percent", "truncation_rate", "depth_m")


def read_points(context: Context, run_id: str, column: str, *, limit: int) -> dict[str, Any]:
    """Every evaluated person of a run; of a large run an even sample of the variants, always the same.

    Args:
        context: of the process.
        run_id: the run.
        column: of `PLOTTED`.
        limit: about so many points at most.

    Returns:
        names (``functions``, ``sensors``, ``cameras``, ``characters``), lists of equal length (``x``, ``pacc``, ``variant``,
        ``camera`` …) whose codes are positions in the names, ``undefined`` by reason, and the ``share`` of the variants shown.

    Raises:
        NotFound, Conflict, UnknownName: no such run, its asset changed, no such column.
    """
    with reading(context.engine) as connection:
        run = runs.get(connection, run_id)
        resolved = resolve_stored(run, context.settings)
        evaluated = (run.progress or {}).get("stages", {}).get("eval", {}).get("done", 0)
        share = min(1.0, limit / max(evaluated * max(len(resolved.manifest.persons), 1), 1))
        rows = results.points(connection, run_id, column, share=share)
        assignments = results.assignments(connection, run_id, {row.variant_index for row in rows})
    names = ("x", "pacc", "variant", "camera", "time", "sensor", "function", "character", "instance")
    columns: dict[str, list[Any]] = {name: [] for name in names}
    characters: dict[str, int] = {}
    undefined: Counter[str] = Counter()
    for row in rows:
        if row.pacc is None:
            undefined[row.undefined_reason or "no value"] += 1
            continue
        if row.x is None:
            continue
        character = character_of(row.instance_id, assignments[row.variant_index], resolved)
        code = -1 if character is None else characters.setdefault(character, len(characters))
        point = (row.x, row.pacc, row.variant_index, row.camera_index, row.time_index, row.sensor_index)
        for name, value in zip(names, (*point, row.function_index, code, row.instance_id), strict=True):
            columns[name].append(value)
    return {
        "column": column,
        "functions": list(resolved.spec.functions),
        "sensors": [setting.name for setting in resolved.spec.sensors],
        "cameras": list(resolved.cameras),
        "characters": list(characters),
        **columns,
        "undefined": dict(undefined),
        "share": share,
    }
