"""Training scenes that show a person in a region of weakness, measured as in a run."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from valerie.analysis.findings.region import Choices, Region
from valerie.labels import PERSON
from valerie.measures import TableRow
from valerie.parameters.definitions import Affects, ParameterDefinition, ParameterType
from valerie.pipeline.retraining.training_scenes import AS_MADE, TrainingScene
from valerie.rendering.base import GroundTruth, View
from valerie.rendering.visibility import measure, person_roots
from valerie.runs.resolving.spec import ResolvedRun
from valerie.scene.assets.attributes import ABSENT, ATTRIBUTES, Target, resolve

#: Quantities that are measured for each person on the truth; the distance is known before.
MEASURED: Final = ("distance_m", "occlusion_rate", "truncation_rate", "pixel_area_percent")
#: Attributes of the person itself.
OF_PERSON: Final = {"heading": ParameterType.ANGLE, "character": ParameterType.CATEGORICAL}
#: Share of garments that keep their colour if the region names characters.
_AS_MADE_CHARACTERS: Final = 0.5


def quantities(resolved: ResolvedRun) -> dict[str, ParameterType]:
    """Return the quantities that a run's region may bound: visibility, heading and character of the person, light, radiometry.

    A position has a meaning on one site only; distance and visibility represent them.
    """
    varied = [d for d in resolved.definitions if d.path in set(resolved.space.varied)]
    types = dict.fromkeys(MEASURED, ParameterType.FLOAT)
    types |= {name: kind for name, kind in OF_PERSON.items() if any(_person_attribute(d) == name for d in varied)}
    types |= {d.path: d.type for d in varied if d.affects in (Affects.LIGHT, Affects.SENSOR_RADIOMETRY)}
    return types


def run_values(instance_id: int, row: TableRow, resolved: ResolvedRun) -> TableRow:
    """Return the quantities of one person of a run, from the columns and parameters of its row."""
    person = f"scene.{PERSON.node_class}-{instance_id % 1000}"
    values = {name: row.get(name) for name in MEASURED}
    for definition in resolved.definitions:
        value = row.get(definition.path, definition.default)
        if definition.path.startswith(f"{person}."):
            attribute = _person_attribute(definition)
            if attribute is not None:
                values[attribute] = value
        elif definition.affects in (Affects.LIGHT, Affects.SENSOR_RADIOMETRY):
            values[definition.path] = value
    return values


class TargetRegion:
    """A region to be shown by drawn scenes."""

    def __init__(self, region: Region) -> None:
        self._region = region
        self.as_made = _AS_MADE_CHARACTERS if isinstance(region.bounds.get("character"), Choices) else AS_MADE

    def possible(self, scene: TrainingScene) -> bool:
        """Return True if some person could be in the region, before anything is rendered."""
        common = self._common(scene)
        return self._region.allows(common) and any(self._region.allows(values) for _, values in self._persons(scene))

    def hit(self, scene: TrainingScene, truth: GroundTruth, view: View) -> bool:
        """Return True if some person is in the region, by measures on the truth."""
        common, persons = self._common(scene), dict(self._persons(scene))
        return any(
            self._region.holds(
                {**common, **persons.get(person.instance_id, {}), **{name: getattr(person, name) for name in MEASURED}}
            )
            for person in measure(truth, scene.scene, view)
            if person.undefined_reason is None
        )

    def _common(self, scene: TrainingScene) -> TableRow:
        """Return the light and radiometry that the region bounds."""
        values: TableRow = {}
        for name in self._region.bounds:
            if name.startswith("sensor."):
                values[name] = getattr(scene.sensor, name.removeprefix("sensor."), None)
            elif name.startswith("scene."):
                thing, attribute = resolve(name, scene.scene.cameras)
                values[name] = attribute.read(scene.scene, thing)
        return values

    def _persons(self, scene: TrainingScene) -> Iterator[tuple[int, TableRow]]:
        camera = scene.scene.cameras[scene.camera]
        for number, root in person_roots(scene.scene).items():
            values = {name: ATTRIBUTES[Target.NODE, name].read(scene.scene, root.path) for name in OF_PERSON}
            if not root.visible or values["character"] == ABSENT:
                continue
            offset = scene.scene.world_transform(root.path)[:3, 3] - camera.position
            yield number, {**values, "distance_m": float(np.linalg.norm(offset))}


def _person_attribute(definition: ParameterDefinition) -> str | None:
    """Return ``heading`` or ``character`` if a person's definition is about that; otherwise None."""
    parts = definition.path.split(".")
    of_person = len(parts) == 3 and parts[1].startswith(f"{PERSON.node_class}-")
    return parts[2] if of_person and parts[2] in OF_PERSON else None
