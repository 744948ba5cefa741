"""The description of an evidence folder as RO-Crate 1.2 (https://w3id.org/ro/crate/1.2)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Final

from valerie.pipeline.evidence.contents import RunFacts
from valerie.pipeline.evidence.evidence_manifest import MANIFEST

METADATA: Final = "ro-crate-metadata.json"
_LICENCE: Final = "The distributor of this folder decides how it may be used."
_FORMATS: Final = {
    ".json": "application/json",
    ".csv": "text/csv",
    ".parquet": "application/vnd.apache.parquet",
    ".html": "text/html",
    ".png": "image/png",
    ".onnx": "application/octet-stream",
}


def write_crate(folder: Path, run: RunFacts, files: Mapping[str, str]) -> None:
    """Write the description; equal input gives equal bytes, since its dates are those of the run.

    Args:
        folder: folder with the files.
        run: the run.
        files: path to description, in order.
    """
    from rocrate.model.contextentity import ContextEntity
    from rocrate.rocrate import ROCrate

    crate = ROCrate(version="1.2")
    crate.name = f"Evidence of the VALERIE run {run.name} ({run.id})"
    crate.description = f"Spec, results, environment and frames of one run; {MANIFEST} lists the files with digests."
    crate.datePublished = (run.finished_at or run.created_at).isoformat()
    licence = {"@type": "CreativeWork", "name": "No licence is stated", "description": _LICENCE}
    crate.license = crate.add(ContextEntity(crate, "#licence", properties=licence))
    for path, description in files.items():
        properties = {"name": path, "description": description, "encodingFormat": _FORMATS[Path(path).suffix]}
        if path != MANIFEST:  # written last, over this description
            properties["contentSize"] = str((folder / path).stat().st_size)
        crate.add_file(folder / path, path, properties=properties)
    crate.metadata.write(folder)
