"""Measure the persons of a spec's variants on the ground truth alone: no picture is rendered, nothing is stored."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass

from valerie import plugins
from valerie.measures import MEASURES, TableRow
from valerie.parameters.assignment import Assignment
from valerie.pipeline.work.makers.rendering import cpu_seconds_elsewhere
from valerie.rendering.base import View
from valerie.rendering.truth import TruthMaker
from valerie.rendering.visibility import Visibility, measure
from valerie.runs.document.run_spec import BlockDocument, RunSpec
from valerie.runs.resolving.spec import ResolvedRun
from valerie.scene.assets.asset import SceneAsset
from valerie.scene.variation.conditions import conditions
from valerie.scene.variation.variant import apply


@dataclass(frozen=True, slots=True)
class MeasuredVariant:
    """A legal variant as its truth shows it.

    Attributes:
        assignment: of the spec's space.
        rows: one for each frame and person, with the columns of the long table; those of functions and light are None.
        cpu_seconds: that the measuring took.
    """

    assignment: Assignment
    rows: tuple[TableRow, ...]
    cpu_seconds: float


def measure_truths(resolved: ResolvedRun, asset: SceneAsset, truth_pass: TruthMaker) -> Iterator[MeasuredVariant]:
    """Yield the legal variants of a spec, measured as in a run.

    Args:
        resolved: the spec.
        asset: its asset, with meshes.
        truth_pass: open in this process.
    """
    for assignment in resolved.space:
        started = time.process_time()
        if resolved.rejection(assignment.values) is None:
            rows = tuple(_rows(resolved, asset, truth_pass, assignment))
            yield MeasuredVariant(assignment, rows, time.process_time() - started)


def _rows(
    resolved: ResolvedRun, asset: SceneAsset, truth_pass: TruthMaker, assignment: Assignment
) -> Iterator[TableRow]:
    resolution = resolved.spec.resolution
    for time_index in range(len(resolved.times.elapsed)):
        moment = resolved.at(assignment.values, time_index)
        scene = apply(moment, asset)
        common = {**assignment.values, **conditions(moment, resolved.manifest)._asdict()}
        for camera in resolved.cameras:
            view = View(camera, resolution.width, resolution.height)
            for person in measure(truth_pass.truth(scene, view), scene, view):
                seen = {name: getattr(person, name) for name in _MEASURED}
                yield {**_EMPTY, **common, **seen, "variant_index": assignment.index, "camera": camera}


def price_of_layers(resolved: ResolvedRun, asset: SceneAsset, variants: Sequence[MeasuredVariant]) -> float:
    """Return the CPU seconds of a layer by the spec's engine: the mean of these variants, over a warm background."""
    spec = resolved.spec
    view = View(resolved.cameras[0], spec.resolution.width, spec.resolution.height)
    with closing(plugins.create_renderer(spec.engine, spec.engine_settings)) as engine:
        scenes = [apply(resolved.at(variant.assignment.values, 0), asset) for variant in variants]
        engine.background(scenes[0], view)
        engine.layer(scenes[0], view)
        started = time.process_time() + cpu_seconds_elsewhere(engine)
        for scene in scenes:
            engine.layer(scene, view)
        return (time.process_time() + cpu_seconds_elsewhere(engine) - started) / len(scenes)


def chosen_spec(resolved: ResolvedRun, variants: Sequence[MeasuredVariant]) -> RunSpec:
    """Return the spec of a choice of its variants, as listed points."""
    blocks = []
    for number, (block, document) in enumerate(zip(resolved.space.blocks, resolved.spec.blocks, strict=True)):
        paths = [variation.path for variation in block.variations] or list(resolved.space.varied)
        chosen = (variant.assignment.values for variant in variants if variant.assignment.block == number)
        points = tuple({path: values[path] for path in paths if path in values} for values in chosen)
        if points:
            blocks.append(BlockDocument(design="points", points=points, constants=document.constants))
    return resolved.spec.model_copy(update={"name": f"{resolved.spec.name}, chosen", "blocks": tuple(blocks)})


_COLUMNS = {column.name for column in MEASURES}
_MEASURED = tuple(name for name in Visibility.__dataclass_fields__ if name in _COLUMNS)
_EMPTY: TableRow = dict.fromkeys(_COLUMNS)
