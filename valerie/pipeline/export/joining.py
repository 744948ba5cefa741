"""The documents of a data set that list all frames, joined from the frames' fragments."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Iterator
from itertools import groupby
from operator import attrgetter
from pathlib import Path
from typing import Final

import pyarrow as pa
import pyarrow.compute
from sqlalchemy import Engine

from valerie.analysis.rows.table import PARAMETER_COLUMNS, without_codes
from valerie.datasets import coco, croissant, openlabel
from valerie.datasets.index import COLUMNS, write_index
from valerie.db import runs
from valerie.db.engine import reading
from valerie.pipeline.export.export_plan import FORMAT_NAME, ExportPlan
from valerie.pipeline.export.folder import FRAGMENTS
from valerie.pipeline.export.frame_files import CocoFragment, Fragment, OpenLabelFragment
from valerie.pipeline.reading.tables import read_table
from valerie.plain import JsonObject
from valerie.rendering.annotations.joints import LIMBS
from valerie.scene.graph.model import JOINTS

#: Description of a finished data set.
DOCUMENT: Final = "dataset.json"


def write_documents(engine: Engine, plan: ExportPlan, folder: Path) -> tuple[dict[str, int], dict[str, float]]:
    """Write the documents that list all frames.

    Args:
        engine: database.
        plan: plan of the export.
        folder: folder with the fragments of all frames.

    Returns:
        Split to number of frames, and class to percentage of its pixels that polygons paint as another class, without zeros.
    """
    settings, resolved = plan.settings, plan.run.resolved
    counts = Counter(fragment.split for fragment in _fragments(plan, folder))
    description = f"VALERIE run {plan.run.id} ({resolved.spec.name})"
    if "coco" in settings.formats:
        for split in counts:
            fragments = (fragment for fragment in _fragments(plan, folder) if fragment.split == split)
            entries = (fragment.coco for fragment in fragments if fragment.coco is not None)
            _write_coco(folder / "coco", split, entries, description)
    if "openlabel" in settings.formats:
        for split in counts:
            labels = (fragment.openlabel for fragment in _fragments(plan, folder) if fragment.split == split)
            _write_openlabel(
                folder / "openlabel" / split, (labelled for labelled in labels if labelled is not None), description
            )
    if "parquet" in settings.formats:
        types = {d.path: without_codes(PARAMETER_COLUMNS[d.type.value]) for d in resolved.definitions}
        rows = (row for fragment in _fragments(plan, folder) for row in fragment.rows)
        write_index(folder / "index.parquet", rows, types)
    if settings.predictions:
        _write_evaluations(engine, plan, folder / "evaluations.parquet")
    lost = _lost_percent(_fragments(plan, folder))
    document = {
        **plan.request(),
        "description": description,
        "splits": counts,
        "asset": resolved.spec.model_dump(mode="json")["asset"],
        "asset_digest": resolved.asset_digest,
        "pins": plan.run.pins.model_dump(mode="json", exclude_none=True),
        "sensor": resolved.spec.sensors[plan.sensor].model_dump(mode="json"),
        "labels": resolved.spec.labels.value,
        "classes": "Cityscapes label ids; instance ids are label id × 1000 + n",
        "polygons_lose_percent": lost,
        "index_columns": {name: text for name, _, text in COLUMNS} if "parquet" in settings.formats else {},
    }
    (folder / DOCUMENT).write_text(json.dumps(document, indent=1, ensure_ascii=False) + "\n")
    with reading(engine) as connection:
        run = runs.get(connection, plan.run.id)
    described = croissant.describe(
        folder,
        name=resolved.spec.name,
        description=description,
        published=run.finished_at or run.created_at,
        version=f"{FORMAT_NAME.partition('/')[2]}.0.0",
    )
    (folder / croissant.FILE).write_text(json.dumps(described, indent=1, ensure_ascii=False) + "\n")
    return counts, lost


def _lost_percent(fragments: Iterable[Fragment]) -> dict[str, float]:
    """Return class to percentage of its pixels that polygons paint as another class, without zeros."""
    pixels, wrong_pixels = Counter[str](), Counter[str]()
    for fragment in fragments:
        for name, (count, wrong) in fragment.lost.items():
            pixels[name] += count
            wrong_pixels[name] += wrong
    return {name: round(100.0 * wrong / pixels[name], 4) for name, wrong in sorted(wrong_pixels.items()) if wrong}


def _fragments(plan: ExportPlan, folder: Path) -> Iterator[Fragment]:
    for frame in plan.frames:
        yield Fragment.model_validate_json((folder / FRAGMENTS / f"{plan.name(frame)}.json").read_bytes())


def _write_coco(folder: Path, split: str, fragments: Iterable[CocoFragment], description: str) -> None:
    images: list[coco.CocoImage] = []
    instances: list[JsonObject] = []
    panoptic: list[coco.PanopticAnnotation] = []
    for number, fragment in enumerate(fragments, start=1):
        images.append(
            {"id": number, "width": fragment.width, "height": fragment.height, "file_name": fragment.file_name}
        )
        panoptic.append(
            {
                "image_id": number,
                "file_name": fragment.panoptic_name,
                "segments_info": fragment.segments,
            }
        )
        for instance in fragment.instances:
            instances.append({"id": len(instances) + 1, "image_id": number, **instance.annotation()})
    for name, entries in (("instances", instances), ("panoptic", panoptic)):
        document = coco.assemble(images, entries, description, key_points=JOINTS, limbs=LIMBS)
        (folder / f"{name}_{split}.json").write_text(json.dumps(document))


def _write_openlabel(folder: Path, fragments: Iterable[OpenLabelFragment], description: str) -> None:
    """Write one document per sequence; the frames of a sequence must be consecutive."""
    for sequence, members in groupby(fragments, attrgetter("sequence")):
        frames = list(members)
        numbered = {fragment.number: fragment.frame for fragment in frames}
        document = openlabel.assemble(numbered, frames[0].camera, description)
        path = folder / f"{sequence}_openlabel.json"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(document))


def _write_evaluations(engine: Engine, plan: ExportPlan, path: Path) -> None:
    """Write the long table's rows of the exported frames, sensor and functions."""
    table = read_table(engine, plan.run)
    frames = pa.array(sorted(str(frame.key) for frame in plan.frames))
    mask = pa.compute.is_in(table.arrow["frame_id"], frames).to_numpy()
    mask &= table.codes("sensor").where(plan.run.resolved.spec.sensors[plan.sensor].name)
    functions = table.codes("function")
    named = functions.where(plan.settings.predictions[0])
    for name in plan.settings.predictions[1:]:
        named = named | functions.where(name)
    table.select(mask & named).to_parquet(path)
