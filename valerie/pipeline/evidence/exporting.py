"""A run's evidence as one folder: spec, results, environment, and the frames that findings and verdicts name."""

from __future__ import annotations

from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Final

import orjson
import pyarrow as pa

from valerie.analysis.findings.findings import Findings
from valerie.analysis.report.odd import odd_json, odd_table
from valerie.analysis.report.register import register, register_json, register_table
from valerie.analysis.rows.table import EvaluationTable, encoded
from valerie.db import frames, runs
from valerie.db.archives import reading_run
from valerie.db.engine import reading
from valerie.db.runs import RunRow
from valerie.pipeline.base.context import Context
from valerie.pipeline.base.resolved_runs import StoredRun, resolve_stored
from valerie.pipeline.base.run_artifacts import ENVIRONMENT, REPORT, SUMMARY, TABLE_CSV, TABLE_PARQUET, read_artifact
from valerie.pipeline.evidence.contents import (
    FRAMES,
    PICTURES,
    PINS,
    RUN,
    SPEC,
    FrameEntry,
    FrameList,
    ResultDigests,
    RunFacts,
)
from valerie.pipeline.evidence.crate import write_crate
from valerie.pipeline.evidence.error_models import stored_error_models, table_digest
from valerie.pipeline.evidence.evidence_manifest import (
    MANIFEST,
    SIGNED,
    document_bytes,
    manifest_of,
    plain_files,
    sha256_of,
    tree_root,
)
from valerie.pipeline.evidence.signing import read_private_key, sign
from valerie.pipeline.export.folder import new_folder, require_free_name, require_room
from valerie.pipeline.reading.frame_pictures import find_picture, paint_picture
from valerie.pipeline.reading.named_frames import NamedFrame, named_frames
from valerie.pipeline.reading.painting import png
from valerie.pipeline.reading.reports import read_odd
from valerie.pipeline.reading.selection import function_index, sensor_index
from valerie.plain import typed
from valerie.runs.products.pins import TolerantPins

#: Bytes per pixel of a picture and of a painted class map, as PNG; rounded up.
_PICTURE_BYTES, _MAP_BYTES = 2.5, 0.3
#: Artifacts of the end of a run, each with its description.
_RESULTS: Final = {
    TABLE_PARQUET: "Long table: one row per person in each evaluation",
    TABLE_CSV: "Long table as CSV",
    SUMMARY: "Summary, findings and verdicts",
    REPORT: "Report for people",
    ENVIRONMENT: "Python, machine and package versions of the process that wrote the results",
}
REGISTER_JSON: Final = "register.json"
REGISTER_CSV: Final = "register.csv"
ODD_JSON: Final = "odd.json"
ODD_CSV: Final = "odd.csv"
#: Descriptions of the files of error models, by the end of the name.
_ERROR_MODEL_FILES: Final = {
    ".json": "Card of the perception-error models: columns, calibration on held-out places, limits",
    ".csv": "Answers of the perception-error models in each cell of their support",
    ".parquet": "The same as Parquet",
    ".png": "Reliability diagram of the perception-error models",
    ".onnx": "Perception-error model of one function",
}
_DOCUMENTS: Final = {
    SPEC: "The exact spec of the run",
    RUN: "The run: state, dates, digests of spec, asset and results",
    PINS: "Numeric classes, revisions and file digests that the run pinned, with the cards of its functions",
    **_RESULTS,
    REGISTER_JSON: "Register of triggering conditions that the findings show, with evidence and re-tests",
    REGISTER_CSV: "The same as CSV",
    ODD_JSON: "Coverage of the operational design domain: levels and pairs of levels of its parameters, and the holes",
    ODD_CSV: "The same as CSV",
    FRAMES: "The frames that findings and verdicts name: variant, camera, time, sensor, functions",
    MANIFEST: "SHA-256 of each file and the root over them",
}


@dataclass(frozen=True, slots=True)
class ExportedEvidence:
    """The result of an export.

    Attributes:
        folder: the new folder.
        files: number of files in its manifest.
        frames: number of frames, each through one sensor setting.
        root: Merkle root over the files, hex.
        signer: id of the key; None if the folder is not signed.
    """

    folder: Path
    files: int
    frames: int
    root: str
    signer: str | None


def export_evidence(context: Context, run_id: str, out: Path, *, key: Path | None = None) -> ExportedEvidence:
    """Write the evidence of an ended run. A second export has equal bytes.

    Args:
        context: database and artifact store.
        run_id: id of the run.
        out: folder to create; must not exist, or be empty.
        key: file of a private Ed25519 key; None: the folder is not signed.

    Raises:
        NotFound: no such run.
        Conflict: the run has not ended, ``out`` is not empty, or the products of a named frame are gone.
        MissingInput: the object of a named frame is gone.
        InvalidInput: not a private key.
        Refused: the files are too many or too large (`valerie.pipeline.evidence.evidence_manifest`).
        StorageFull, StorageUnavailable: ``out`` cannot be written.
    """
    signer = None if key is None else read_private_key(key)
    with reading(context.engine) as connection:
        run = runs.get(connection, run_id)
    results = {name: read_artifact(context, run_id, name) for name in _RESULTS}
    table = EvaluationTable.from_parquet(pa.BufferReader(results[TABLE_PARQUET]))
    digest = table_digest(table)
    models = stored_error_models(context, run_id, digest)
    stored = resolve_stored(run, context.settings)
    summary = orjson.loads(results[SUMMARY])
    named = named_frames([summary["findings"], summary["verdicts"]])
    require_free_name(out)
    files = results | models
    _require_room(context, stored, out, named, sum(map(len, files.values())))
    with new_folder(out) as partial:
        for name, data in files.items():
            (partial / name).write_bytes(data)
        conditions = register(typed(Findings, summary["findings"]))
        (partial / REGISTER_JSON).write_bytes(document_bytes(register_json(conditions)))
        (partial / REGISTER_CSV).write_bytes(encoded(register_table(conditions), "csv"))
        coverage = read_odd(stored.resolved, table)
        (partial / ODD_JSON).write_bytes(document_bytes(odd_json(coverage)))
        (partial / ODD_CSV).write_bytes(encoded(odd_table(coverage), "csv"))
        descriptions = _DOCUMENTS | {name: _ERROR_MODEL_FILES[Path(name).suffix] for name in models}
        if isinstance(stored.pins, TolerantPins):
            descriptions[PINS] += f"; the run accepts all classes that agree in {stored.pins.bounds.text}"
        entries = []
        for frame in named:
            entry = _write_frame(context, stored, frame, partial)
            entries.append(entry)
            descriptions |= {picture.file: f"{picture.kind} of frame {frame.key}" for picture in entry.pictures}
        listed = FrameList(frames=tuple(entries))
        facts = _facts(run, partial, table=digest, verdicts=summary["verdicts"])
        for name, document in (
            (SPEC, run.spec.model_dump(mode="json")),
            (RUN, facts.model_dump(mode="json")),
            (PINS, stored.pins.model_dump(mode="json")),
            (FRAMES, listed.model_dump(mode="json")),
        ):
            (partial / name).write_bytes(document_bytes(document))
        (partial / MANIFEST).touch()  # so that the description can name it
        write_crate(partial, facts, descriptions)
        manifest = manifest_of(partial)
        payload = manifest.to_bytes()
        (partial / MANIFEST).write_bytes(payload)
        if signer is not None:
            (partial / SIGNED).write_bytes(sign(payload, signer))
    signer_id = None if signer is None else str(signer.public_key.keyid)
    return ExportedEvidence(out, len(manifest.subject), len(entries), manifest.predicate.root, signer_id)


def _require_room(context: Context, stored: StoredRun, out: Path, named: list[NamedFrame], results: int) -> None:
    size = stored.resolved.spec.resolution
    maps = sum(1 + len(frame.functions) * (1 + 2 * len(frame.persons)) for frame in named)
    pictures = size.width * size.height * (len(named) * _PICTURE_BYTES + maps * _MAP_BYTES)
    require_room(out, results + pictures, f"the evidence with {len(named):,} frames", context.settings.min_free_mb)


def _write_frame(context: Context, stored: StoredRun, frame: NamedFrame, folder: Path) -> FrameEntry:
    """Write the pictures of a frame; return its entry."""
    resolved = stored.resolved
    functions = {function_index(name, resolved): name for name in sorted(frame.functions)}
    with reading_run(context.engine, frame.key.run_id) as connection:
        assignment = frames.get(connection, frame.key).assignment
    entry = FrameEntry(
        variant=frame.key.variant,
        camera=frame.key.camera,
        time=frame.key.time,
        sensor=sensor_index(frame.sensor, resolved),
        functions=tuple(sorted(functions)),
        persons=tuple(sorted(frame.persons)),
        assignment=dict(assignment),
    )
    for picture in entry.pictures:
        kind = picture.kind if picture.person is None else "errors"
        function = None if picture.function is None else functions[picture.function]
        source = find_picture(context, frame.key, kind=kind, sensor=frame.sensor, function=function)
        (folder / picture.file).parent.mkdir(parents=True, exist_ok=True)
        (folder / picture.file).write_bytes(png(paint_picture(context, source, person=picture.person)))
    return entry


def _facts(run: RunRow, folder: Path, *, table: str, verdicts: object) -> RunFacts:
    names = (name for name in plain_files(folder) if name.startswith(f"{PICTURES}/"))
    pictures = {name: sha256_of(folder / name) for name in names}
    results = ResultDigests(
        frames=tree_root(pictures),
        table=table,
        verdicts=sha256(document_bytes(verdicts)).hexdigest(),
    )
    return RunFacts(
        id=run.id,
        name=run.name,
        state=run.state,
        spec_digest=run.spec_digest,
        asset_digest=run.asset_digest,
        parent_run=run.parent_run,
        iteration=run.iteration,
        created_at=run.created_at,
        started_at=run.started_at,
        finished_at=run.finished_at,
        results=results,
    )
