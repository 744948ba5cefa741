"""What a function has learned from: assets with their sites, and data sets."""

from __future__ import annotations

import re
from typing import Final

from valerie.perception.documents.function import FunctionDocument

#: Entry of the provenance of training frames with their site seeds. The files of the shipped networks have it under this name.
SITE_SEEDS: Final = "street-seeds"
#: Entries of networks that `valerie train fit` made: asset and site seeds of their frames, and site seeds of the networks that
#: they began with.
ASSET: Final = "frames-asset"
SEEDS: Final = f"frames-{SITE_SEEDS}"
SEEDS_BEFORE: Final = f"{SITE_SEEDS}-before"
#: Separator between ranges of seeds.
SEPARATOR: Final = "; "


def trained_on(document: FunctionDocument) -> dict[str, str]:
    """Return name of an asset or data set to the part that the function has seen, of a generated asset its site seeds.

    The document states it, or else the provenance of a network that was trained here.
    """
    if document.trained_on:
        return document.trained_on
    asset, provenance = document.provenance.get(ASSET), document.provenance
    seeds = SEPARATOR.join(provenance[name] for name in (SEEDS, SEEDS_BEFORE) if name in provenance)
    return {} if asset is None else {asset: seeds}


def ranges(text: str) -> tuple[range, ...]:
    """Return the ranges of seeds in a text like ``1000-1094; 1100``, in order."""
    pairs = sorted({(int(first), int(last or first)) for first, last in re.findall(r"(\d+)(?:-(\d+))?", text)})
    return tuple(range(first, last + 1) for first, last in pairs)


def has_seen(document: FunctionDocument, asset: str, seed: int | None) -> bool:
    """Return True if the function was trained on a site of an asset.

    Args:
        document: document of the function.
        asset: name of the asset.
        seed: of the site; None for an asset that is one place.
    """
    part = trained_on(document).get(asset)
    if part is None:
        return False
    return seed is None or not ranges(part) or any(seed in seeds for seeds in ranges(part))
