"""The scenes of a run's frames: frames of two runs match if their scenes are equal, whatever engine rendered them.

On request frames match across parameters that each run holds at a value of its own, as of a run by day and one at dusk.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from valerie.analysis.comparison.wording import difference_of_specs
from valerie.analysis.rows.pairing import HeldParameters
from valerie.analysis.rows.table import EvaluationTable
from valerie.errors import InvalidInput
from valerie.parameters.assignment import digest
from valerie.parameters.definitions import Value
from valerie.parameters.paths import short_name
from valerie.pipeline.base.progress import Count
from valerie.pipeline.base.resolved_runs import StoredRun
from valerie.runs.document.differing import differing_fields
from valerie.runs.products.frame_keys import FrameKey
from valerie.scene.variation.variant import Inputs, split


@dataclass(frozen=True, slots=True, eq=False)
class SceneRun:
    """A run with the rows whose scenes are compared."""

    stored: StoredRun
    table: EvaluationTable

    def scenes(self, across: Collection[str] = (), progress: Count = lambda *_: None) -> NDArray[np.object_]:
        """Return the (N,) digest of each row's scene, camera and sensor values, without the engine.

        Args:
            across: paths whose values do not count.
            progress: is told the number of frames.
        """
        asset, frames = self.stored.resolved.asset_digest, self.table.codes("frame_id")
        scenes = []
        for camera, inputs in self.inputs():
            parts: list[object] = [inputs.layer, inputs.sensor]
            if across:
                parts = [{path: value for path, value in _values(inputs).items() if path not in across}]
            scenes.append(digest("scene", asset, camera, *parts))
            progress(len(scenes), len(frames.names))
        return np.array(scenes, dtype=object)[frames.index]

    def inputs(self) -> Iterator[tuple[str, Inputs]]:
        """Yield camera and inputs of each frame."""
        resolved = self.stored.resolved
        for name in self.table.codes("frame_id").names:
            key = FrameKey.parse(name)
            camera = resolved.cameras[key.camera]
            values = resolved.at(resolved.space[key.variant].values, key.time)
            yield camera, split(values, resolved.manifest, camera)


def _values(inputs: Inputs) -> dict[str, Value]:
    return {**json.loads(inputs.layer), **inputs.sensor}


def _held(*runs: SceneRun) -> HeldParameters:
    """Return the value of each path in the first frame of each run that has it, None if none has."""
    varying = {}
    first: list[dict[str, Value]] = []
    for run in runs:
        first.append({})
        for _, inputs in run.inputs():
            for path, value in _values(inputs).items():
                if first[-1].setdefault(path, value) != value:
                    varying[path] = run.stored.id
    here, there = first
    return HeldParameters({path: (here.get(path), there.get(path)) for path in sorted({*here, *there})}, varying)


def match_scenes(
    here: SceneRun, there: SceneRun, across: Sequence[str] = (), progress: Count = lambda *_: None
) -> tuple[NDArray[np.object_], NDArray[np.object_], tuple[str, ...]]:
    """Return the scene of each row of two runs, and in words what they hold at different values.

    Args:
        here, there: the runs.
        across: names or paths of parameters that each run holds at a value of its own.
        progress: is told the number of frames of each run.

    Raises:
        InvalidInput: no scene is common, or a parameter of ``across`` is unknown or varies inside a run.
    """
    held = _held(here, there) if across else HeldParameters({}, {})
    paths = held.paths(across, field="--across")
    one, other = (run.scenes(paths, progress) for run in (here, there))
    if set(one).isdisjoint(other):
        raise _unmatched(here, there)
    return one, other, tuple(difference_of_specs(short_name(path), *held.values[path]) for path in paths)


def _unmatched(here: SceneRun, there: SceneRun) -> InvalidInput:
    own, other = here.stored.resolved, there.stored.resolved
    fields = differing_fields(own.spec, other.spec, same_asset=own.asset_digest == other.asset_digest)
    paths = _held(here, there).own
    helps = paths and not set(here.scenes(paths)).isdisjoint(there.scenes(paths))
    options = " ".join(f"--across {short_name(path)}" for path in paths)
    return InvalidInput(
        f"no frame of one run shows the same scene as a frame of the other; what differs: {', '.join(fields)}; "
        + (f"`valerie compare … {options}` pairs them" if helps else "no --across pairs them"),
        field="other",
        value=there.stored.id,
    )
