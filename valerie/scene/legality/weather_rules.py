"""Weather that contradicts itself.

Snow in summer and leaves before autumn need no rule: an asset declares the parameters of its season only.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from valerie.parameters.definitions import Value
from valerie.scene.assets.manifest import Manifest
from valerie.scene.graph.naming import ENVIRONMENT_PATH

#: Rain and snowfall.
WEATHER_PATHS: Final = frozenset({f"{ENVIRONMENT_PATH}.rain", f"{ENVIRONMENT_PATH}.snowfall"})


def weather_reason(assignment: Mapping[str, Value], manifest: Manifest) -> str | None:
    """Return the reason why a variant's weather is impossible; None if it is not.

    Rain and snowfall exclude each other, since no engine shows sleet. Rain on lying snow is a thaw.

    Args:
        assignment: path to value; missing values take their defaults.
    """
    if not manifest.by_path.keys() >= WEATHER_PATHS:
        return None
    falling = (float(assignment.get(path, manifest.by_path[path].default)) > 0 for path in WEATHER_PATHS)
    return "rain and snow fall at once" if all(falling) else None
