"""A folder of training frames: pictures with their label maps, compressed, with random access.

A *shard* is one safetensors file with the frames of one site; each map in it is one zstd frame, so one training frame can be
read without the rest. ``frames.json`` lists the shards with their digests; its own digest identifies the data set.
"""

from __future__ import annotations

import hashlib
import json
import threading
from abc import abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal, overload

import numpy as np
import zstandard
from numpy.typing import NDArray
from pydantic import Field, ValidationError
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file

from valerie.document import Document
from valerie.errors import CorruptArtifact, InvalidInput, NotFound

Split = Literal["train", "held-out"]

#: Site seeds of each split; seed 0, the default of runs, is in neither.
SEEDS: Final[dict[Split, range]] = {"train": range(1000, 100_000), "held-out": range(900, 1000)}
INDEX_NAME: Final = "frames.json"
FORMAT: Final = "valerie-training-frames/1"
_LEVEL: Final = 3


@dataclass(frozen=True, slots=True, eq=False)
class TrainingFrame:
    """One sample.

    Attributes:
        picture: (H, W, 3) uint8 sRGB.
        train_ids: (H, W) uint8, 0…18 or 255 (void).
        site_seed: seed of its site; training and held-out frames share no site.
    """

    picture: NDArray[np.uint8]
    train_ids: NDArray[np.uint8]
    site_seed: int

    def __post_init__(self) -> None:
        height_width = self.train_ids.shape
        has_types = self.picture.dtype == np.uint8 and self.train_ids.dtype == np.uint8
        if not has_types or len(height_width) != 2 or self.picture.shape != (*height_width, 3):
            layout = f"{self.picture.dtype} {self.picture.shape}, {self.train_ids.dtype} {height_width}"
            raise InvalidInput("not a training frame", value=layout, limit="uint8 (H, W, 3) and uint8 (H, W)")


class Shard(Document):
    """One file of the folder.

    Attributes:
        file: name of the file.
        site_seed: of all its frames.
        sizes: (height, width) of each frame.
        sha256: digest of the file.
        drawn: number of scenes that were drawn to get these frames; None if every draw was used.
    """

    file: str = Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*\.safetensors$")
    site_seed: int
    sizes: tuple[tuple[int, int], ...]
    sha256: str = Field(pattern=r"^[0-9a-f]{64}$")
    drawn: int | None = None


class FrameIndex(Document):
    """The contents of ``frames.json``.

    Attributes:
        shards: shards by ascending site seed.
        provenance: origin of the frames: asset, seeds, revisions.
    """

    format: str = Field(FORMAT, pattern=f"^{FORMAT}$")
    shards: tuple[Shard, ...]
    provenance: dict[str, str] = Field(default={})


def write_shard(folder: Path, site_seed: int, frames: Iterable[TrainingFrame]) -> Shard:
    """Write the frames of one site as one file; equal frames give equal bytes.

    Raises:
        InvalidInput: a frame belongs to another site.
    """
    compressor = zstandard.ZstdCompressor(level=_LEVEL)
    tensors: dict[str, NDArray[np.uint8]] = {}
    sizes: list[tuple[int, int]] = []
    for number, frame in enumerate(frames):
        if frame.site_seed != site_seed:
            raise InvalidInput("a frame of another site", field="site_seed", value=frame.site_seed)
        for kind, array in (("picture", frame.picture), ("labels", frame.train_ids)):
            packed = compressor.compress(np.ascontiguousarray(array).tobytes())
            tensors[f"{number:05}.{kind}"] = np.frombuffer(packed, np.uint8)
        height, width = frame.train_ids.shape
        sizes.append((height, width))
    path = folder / f"site-{site_seed:06}.safetensors"
    save_file(tensors, path)
    sha256 = hashlib.sha256(path.read_bytes()).hexdigest()
    return Shard(file=path.name, site_seed=site_seed, sizes=tuple(sizes), sha256=sha256)


def write_index(folder: Path, shards: Iterable[Shard], provenance: Mapping[str, str]) -> None:
    """Write the index of the shards, which makes the folder complete and readable."""
    ordered = tuple(sorted(shards, key=lambda shard: shard.site_seed))
    index = FrameIndex(format=FORMAT, shards=ordered, provenance=dict(sorted(provenance.items())))
    (folder / INDEX_NAME).write_text(json.dumps(index.model_dump(exclude_none=True), indent=1) + "\n")


class Frames(Sequence[TrainingFrame]):
    """A sequence of frames that are read on access."""

    @abstractmethod
    def _frame(self, number: int) -> TrainingFrame:
        """Return a frame by its number, −`len` to `len` − 1; raise IndexError outside."""

    @overload
    def __getitem__(self, index: int) -> TrainingFrame: ...

    @overload
    def __getitem__(self, index: slice) -> list[TrainingFrame]: ...

    def __getitem__(self, index: int | slice) -> TrainingFrame | list[TrainingFrame]:
        if isinstance(index, slice):
            return [self._frame(number) for number in range(*index.indices(len(self)))]
        return self._frame(index)


class FrameFolder(Frames):
    """The frames of a folder; several threads may read them.

    Raises:
        NotFound: there is no ``frames.json``: not a folder of frames, or rendering was interrupted.
        InvalidInput: ``frames.json`` was not written by `write_index`.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        try:
            text = (folder / INDEX_NAME).read_bytes()
        except FileNotFoundError:
            raise NotFound("folder of training frames", folder) from None
        try:
            self.listing = FrameIndex.model_validate_json(text)
        except ValidationError as error:
            raise InvalidInput(f"not an index of training frames ({error})", field=INDEX_NAME) from error
        #: SHA-256 of the index, which contains the digests of the shards, so it covers every pixel.
        self.digest = hashlib.sha256(text).hexdigest()
        self._places = [(shard, number) for shard in self.listing.shards for number in range(len(shard.sizes))]
        self._open = threading.local()  # threads must not share a file handle

    @property
    def site_seeds(self) -> frozenset[int]:
        """Seeds of all sites in the folder."""
        return frozenset(shard.site_seed for shard in self.listing.shards)

    def verify(self) -> None:
        """Compare every shard with its digest.

        Raises:
            CorruptArtifact: names the first shard that differs.
        """
        for shard in self.listing.shards:
            data = (self.folder / shard.file).read_bytes()
            if hashlib.sha256(data).hexdigest() != shard.sha256:
                raise CorruptArtifact(f"{shard.file} is not the file that {INDEX_NAME} lists")

    def __len__(self) -> int:
        return len(self._places)

    def _frame(self, number: int) -> TrainingFrame:
        shard, number = self._places[number]
        height, width = shard.sizes[number]
        return TrainingFrame(
            picture=self._array(shard, f"{number:05}.picture", (height, width, 3)),
            train_ids=self._array(shard, f"{number:05}.labels", (height, width)),
            site_seed=shard.site_seed,
        )

    def _array(self, shard: Shard, name: str, shape: tuple[int, ...]) -> NDArray[np.uint8]:
        size = int(np.prod(shape))
        try:
            packed: NDArray[np.uint8] = self._handle(shard).get_tensor(name)
            raw = zstandard.ZstdDecompressor().decompress(packed.tobytes(), max_output_size=size)
        except (SafetensorError, zstandard.ZstdError, OSError) as error:
            raise CorruptArtifact(f"{shard.file}: {name} cannot be read ({error})") from error
        if len(raw) != size:
            raise CorruptArtifact(f"{shard.file}: {name} has {len(raw)} bytes instead of {size}")
        return np.frombuffer(raw, np.uint8).reshape(shape)

    def _handle(self, shard: Shard) -> Any:
        handles: dict[str, safe_open] | None = getattr(self._open, "handles", None)
        if handles is None:
            handles = self._open.handles = {}
        if shard.file not in handles:
            handles[shard.file] = safe_open(self.folder / shard.file, framework="numpy")
        return handles[shard.file]
