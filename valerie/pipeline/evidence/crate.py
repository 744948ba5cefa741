"""The description of an evidence folder as RO-Crate 1.2 (https://w3id.org/ro/crate/1.2)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Final

from valerie.pipeline.evidence.contents import RunFacts

METADATA: Final = "ro-crate-metadata.json"
_FORMATS: Final = {
    ".json": "application/json",
    ".csv": "text/csv",
    ".parquet": "application/vnd.apache.parquet",
    ".html": "text/html",
    ".png": "image/png",
}


def write_crate(folder: Path, run: RunFacts, software: str, files: Mapping[str, str]) -> None:
    """Write the description; equal input gives equal bytes, since its dates are those of the run.

    Args:
        folder: with the files.
        run: that the evidence is about.
        software: name and version of the program.
        files: path to description, in the order in which they are listed.
    """
    from rocrate.model import ContextEntity
    from rocrate.rocrate import ROCrate

    crate = ROCrate(version="1.2")
    crate.name = f"Evidence of the VALERIE run {run.name} ({run.id})"
    crate.description = "Spec, results, environment and frames of one run; manifest.json lists the files with digests."
    crate.datePublished = (run.finished_at or run.created_at).isoformat()
    crate.license = "No licence is stated. Whoever hands out this folder decides how it may be used."
    entities = {
        path: crate.add_file(
            folder / path, path, properties={"name": text, "encodingFormat": _FORMATS[Path(path).suffix]}
        )
        for path, text in files.items()
    }
    program = crate.add(ContextEntity(crate, "#software", {"@type": "SoftwareApplication", "name": software}))
    action = {
        "@type": "CreateAction",
        "name": f"Run {run.id}",
        "startTime": run.created_at.isoformat(),
        "endTime": crate.datePublished.isoformat(),
    }
    made = crate.add(ContextEntity(crate, "#run", action))
    made["instrument"], made["object"] = program, entities["spec.json"]
    made["result"] = [entity for path, entity in entities.items() if path != "spec.json"]
    crate.root_dataset["mentions"] = made
    crate.metadata.write(folder)
