"""What a trained function file says of where it comes from."""

from __future__ import annotations

from pathlib import Path

from valerie.perception.function_file import read_header
from valerie.perception.training.frames import FrameFolder


def training_provenance(frames: FrameFolder, held_out: FrameFolder | None, start_from: Path | None) -> dict[str, str]:
    """Header entries: the frames it learned from and was checked on, and the file that it began with.

    Raises:
        NotFound, InvalidInput: ``start_from`` is missing or damaged.
    """
    provenance = {f"frames-{name}": text for name, text in frames.listing.provenance.items()}
    provenance |= {"frames": str(len(frames)), "frames-digest": frames.digest, "licence": "Apache-2.0"}
    if held_out is not None:
        provenance["held-out-digest"] = held_out.digest
        provenance["held-out-street-seeds"] = held_out.listing.provenance.get("street-seeds", "unknown")
    if start_from is not None:
        before = read_header(start_from)
        provenance["started-from"] = before.digest
        provenance["licence"] = before.provenance.get("licence", "that of the weights it began with")
        provenance["steps-before"] = str(
            int(before.provenance.get("steps", "0")) + int(before.provenance.get("steps-before", "0"))
        )
    return provenance
