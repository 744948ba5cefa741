"""Provenance of trained function files."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from valerie.perception.documents.training_data import SEEDS, SEEDS_BEFORE, SEPARATOR, SITE_SEEDS, ranges
from valerie.perception.importing.function_file import read_header
from valerie.perception.training.frame_folder import FrameFolder
from valerie.perception.training.training_set import TrainingSet


def training_provenance(frames: TrainingSet, held_out: FrameFolder | None, start_from: Path | None) -> dict[str, str]:
    """Return header entries about the frames of training and validation and the file with the first weights.

    Raises:
        NotFound, InvalidInput: ``start_from`` is missing or damaged.
    """
    provenance = {f"frames-{name}": text for name, text in frames.provenance().items()}
    provenance |= {"frames": str(len(frames)), "frames-digest": frames.digest, "licence": "Apache-2.0"}
    if held_out is not None:
        provenance["held-out-digest"] = held_out.digest
        provenance[f"held-out-{SITE_SEEDS}"] = held_out.listing.provenance.get(SITE_SEEDS, "unknown")
    if start_from is not None:
        before = read_header(start_from)
        provenance["started-from"] = before.digest
        provenance["licence"] = before.provenance.get("licence", "that of the weights it began with")
        provenance["steps-before"] = str(
            int(before.provenance.get("steps", "0")) + int(before.provenance.get("steps-before", "0"))
        )
        if sites := sites_seen(before.provenance):
            provenance[SEEDS_BEFORE] = SEPARATOR.join(f"{seeds[0]}-{seeds[-1]}" for seeds in sites)
    return provenance


def sites_seen(provenance: Mapping[str, str]) -> tuple[range, ...]:
    """Return the site seeds that a network and its predecessors were trained on; empty if the provenance states none."""
    return ranges(SEPARATOR.join(provenance.get(name, "") for name in (SEEDS, SEEDS_BEFORE)))
