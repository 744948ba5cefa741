"""Training sets: the frames of one or several folders, each of which may count more than once."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Final

from valerie.errors import InvalidInput
from valerie.perception.documents.training_data import SEPARATOR
from valerie.perception.training.frame_folder import SEEDS, FrameFolder, Frames, TrainingFrame

_UNSTATED: Final = "unstated"


class TrainingSet(Frames):
    """The concatenated frames of several folders. A folder that counts n times is repeated n times.

    Args:
        folders: folders to learn from, each listed as often as it counts. Folders with equal frames are the same folder. They
            keep the order of their first appearance.

    Attributes:
        digest: digest of every pixel and its count; that of the folder if a single one counts once.
        site_seeds: seeds of all sites.

    Raises:
        InvalidInput: there is no folder, a site is kept apart from training, or sites belong to different assets, whose
            seeds cannot be compared.
    """

    def __init__(self, folders: Sequence[FrameFolder]) -> None:
        if not folders:
            raise InvalidInput("no frames to train on", field="frames", limit="at least one folder")
        by_digest = {folder.digest: folder for folder in reversed(folders)}
        times = Counter(folder.digest for folder in folders)  # in the order of first appearance
        self._counted = [(by_digest[digest], count) for digest, count in times.items()]
        self._places = [
            (folder, number) for folder, count in self._counted for _ in range(count) for number in range(len(folder))
        ]
        self.digest = _digest(self._counted)
        self.site_seeds = frozenset[int]().union(*(folder.site_seeds for folder, _ in self._counted))
        _require_sites_to_train_on(self.site_seeds)
        _require_one_asset(folder for folder, _ in self._counted)

    def provenance(self) -> dict[str, str]:
        """Return the provenance of the folders: one value where they agree, otherwise one part per folder, in their order.

        Several folders, or one that counts more than once, add frames, count and digest of each.
        """
        entries = [folder.listing.provenance for folder, _ in self._counted]
        joined = {name: _joined(entries, name) for name in sorted(set[str]().union(*entries))}
        if self.digest == self._counted[0][0].digest:
            return joined
        return joined | {
            "of-each-folder": SEPARATOR.join(str(len(folder)) for folder, _ in self._counted),
            "times-each-counts": SEPARATOR.join(str(count) for _, count in self._counted),
            "digest-of-each-folder": SEPARATOR.join(folder.digest for folder, _ in self._counted),
        }

    def __len__(self) -> int:
        return len(self._places)

    def _frame(self, number: int) -> TrainingFrame:
        folder, number = self._places[number]
        return folder[number]


def open_training_set(folders: Iterable[Path]) -> TrainingSet:
    """Return the frames of folders, each as often as it is listed.

    Raises:
        NotFound: one is not a folder of frames, or its rendering was interrupted.
        InvalidInput: see `TrainingSet` and `FrameFolder`.
    """
    return TrainingSet([FrameFolder(folder) for folder in folders])


def _digest(counts: Sequence[tuple[FrameFolder, int]]) -> str:
    first, count = counts[0]
    if len(counts) == 1 and count == 1:
        return first.digest
    lines = "".join(f"{count} {folder.digest}\n" for folder, count in counts)
    return hashlib.sha256(lines.encode()).hexdigest()


def _joined(provenances: Sequence[Mapping[str, str]], name: str) -> str:
    values = [provenance.get(name, _UNSTATED) for provenance in provenances]
    return values[0] if len(set(values)) == 1 else SEPARATOR.join(values)


def _require_sites_to_train_on(seeds: Iterable[int]) -> None:
    allowed = SEEDS["train"]
    if kept_apart := sorted(seed for seed in seeds if seed not in allowed):
        raise InvalidInput(
            "sites that are kept apart from training, for runs and for held-out frames",
            field="frames",
            value=kept_apart[:5],
            limit=f"site seeds {allowed[0]}…{allowed[-1]}",
        )


def _require_one_asset(folders: Iterable[FrameFolder]) -> None:
    assets = {folder.listing.provenance.get("asset", _UNSTATED): folder.folder for folder in folders}
    if len(assets) > 1:
        names = ", ".join(f"{asset} in {folder}" for asset, folder in assets.items())
        raise InvalidInput("sites of different assets", field="frames", value=names, limit="one asset")
