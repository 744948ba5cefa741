"""What a network learns from: the frames of one folder or several, of which some may count more than once."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Final

from valerie.errors import InvalidInput
from valerie.perception.training.frame_folder import SEEDS, FrameFolder, Frames, TrainingFrame

#: Between what is said of one folder and of the next.
SEPARATOR: Final = "; "
_UNSTATED: Final = "unstated"


class TrainingSet(Frames):
    """Folders one after the other; the frames of one that counts n times stand there n times, one pass after the other.

    Args:
        folders: to learn from, each as often as it is to count. Folders of the same frames are one; they stand in the order
            in which they come first.

    Attributes:
        digest: stands for every pixel and for how often it counts: that of the folder, if there is one and it counts once.
        street_seeds: of all streets.

    Raises:
        InvalidInput: none; streets that are kept apart from training; or streets of different assets, whose seeds mean nothing
            beside each other.
    """

    def __init__(self, folders: Sequence[FrameFolder]) -> None:
        if not folders:
            raise InvalidInput("no frames to train on", field="frames", limit="at least one folder")
        by_digest = {folder.digest: folder for folder in reversed(folders)}
        times = Counter(folder.digest for folder in folders)  # in the order in which they come first
        self._counted = [(by_digest[digest], count) for digest, count in times.items()]
        self._places = [
            (folder, number) for folder, count in self._counted for _ in range(count) for number in range(len(folder))
        ]
        self.digest = _digest(self._counted)
        self.street_seeds = frozenset[int]().union(*(folder.street_seeds for folder, _ in self._counted))
        _require_streets_to_train_on(self.street_seeds)
        _require_one_asset(folder for folder, _ in self._counted)

    def provenance(self) -> dict[str, str]:
        """What the folders say of themselves. Where they agree it stands once; else there is one part for each, in the order of
        the folders. Several folders, or one that counts more than once, come with frames, count and digest of each.
        """
        said = [folder.listing.provenance for folder, _ in self._counted]
        joined = {name: _joined(said, name) for name in sorted(set[str]().union(*said))}
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
    """The frames of these folders, each as often as it is named.

    Raises:
        NotFound: one is no folder of frames, or its making was interrupted.
        InvalidInput: as `TrainingSet` and `FrameFolder`.
    """
    return TrainingSet([FrameFolder(folder) for folder in folders])


def _digest(counted: Sequence[tuple[FrameFolder, int]]) -> str:
    first, count = counted[0]
    if len(counted) == 1 and count == 1:
        return first.digest
    listed = "".join(f"{count} {folder.digest}\n" for folder, count in counted)
    return hashlib.sha256(listed.encode()).hexdigest()


def _joined(said: Sequence[Mapping[str, str]], name: str) -> str:
    values = [entries.get(name, _UNSTATED) for entries in said]
    return values[0] if len(set(values)) == 1 else SEPARATOR.join(values)


def _require_streets_to_train_on(seeds: Iterable[int]) -> None:
    allowed = SEEDS["train"]
    if kept_apart := sorted(seed for seed in seeds if seed not in allowed):
        raise InvalidInput(
            "streets that are kept apart from training, for runs and for held-out frames",
            field="frames",
            value=kept_apart[:5],
            limit=f"street seeds {allowed[0]}…{allowed[-1]}",
        )


def _require_one_asset(folders: Iterable[FrameFolder]) -> None:
    assets = {folder.listing.provenance.get("asset", _UNSTATED): folder.folder for folder in folders}
    if len(assets) > 1:
        shown = ", ".join(f"{asset} in {folder}" for asset, folder in assets.items())
        raise InvalidInput("streets of different assets", field="frames", value=shown, limit="one asset")
