"""The folder layout of Cityscapes (Cordts et al. 2016, arXiv:1604.01685), written and read.

::

    leftImg8bit/<split>/<city>/<name>_leftImg8bit.png             picture
    gtFine/<split>/<city>/<name>_gtFine_labelIds.png              label ids
    gtFine/<split>/<city>/<name>_gtFine_instanceIds.png           16 bit: label id × 1000 + n; label id without instance
    gtFine/<split>/<city>/<name>_gtFine_color.png                 for people
    gtFine/<split>/<city>/<name>_gtFine_polygons.json             optional
    camera/<split>/<city>/<name>_camera.json                      `valerie.datasets.camera`
    predictions/<function>/<split>/<city>/<name>_pred_labelIds.png   a prediction, as label ids
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, overload

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from valerie.datasets.frame import FrameName, LabelledFrame, require_label_ids
from valerie.datasets.polygons import PolygonsDocument
from valerie.errors import CorruptArtifact, InvalidInput, NotFound
from valerie.labels import colorize, to_label_ids

_PICTURE: Final = "leftImg8bit"
_LABELS: Final = "gtFine"


def picture_path(split: str, name: FrameName) -> Path:
    """Return the path of a picture below the data set's folder."""
    return Path(_PICTURE, split, name.city, f"{name}_{_PICTURE}.png")


def labels_path(split: str, name: FrameName, kind: str) -> Path:
    """Return the path of one kind of truth: ``labelIds.png``, ``instanceIds.png``, ``color.png``, ``polygons.json``."""
    return Path(_LABELS, split, name.city, f"{name}_{_LABELS}_{kind}")


def camera_path(split: str, name: FrameName) -> Path:
    """Return the path of a camera's document."""
    return Path("camera", split, name.city, f"{name}_camera.json")


def prediction_path(function: str, split: str, name: FrameName) -> Path:
    """Return the path of a function's prediction."""
    return Path("predictions", function, split, name.city, f"{name}_pred_labelIds.png")


def write_picture(root: Path, split: str, frame: LabelledFrame) -> Path:
    """Write only the picture, and return its path below ``root``."""
    path = picture_path(split, frame.name)
    save_png(root / path, frame.picture)
    return path


def write_labels(root: Path, split: str, frame: LabelledFrame, polygons: PolygonsDocument | None = None) -> None:
    """Write label ids, instance ids, colours, the camera, and polygons if there are any."""
    save_png(root / labels_path(split, frame.name, "labelIds.png"), frame.class_map)
    save_png(root / labels_path(split, frame.name, "instanceIds.png"), frame.segment_ids)
    save_png(root / labels_path(split, frame.name, "color.png"), colorize(frame.class_map))
    if polygons is not None:
        _write_json(root / labels_path(split, frame.name, "polygons.json"), polygons)
    if frame.camera is not None:
        _write_json(root / camera_path(split, frame.name), frame.camera)


def write_prediction(root: Path, split: str, name: FrameName, function: str, train_ids: NDArray[np.uint8]) -> Path:
    """Write a prediction, (H, W) train ids, as label ids (void as 0, unlabeled), and return its path below ``root``."""
    path = prediction_path(function, split, name)
    save_png(root / path, to_label_ids(train_ids))
    return path


@dataclass(frozen=True, slots=True)
class _Entry:
    name: FrameName
    picture: Path
    labels: Path
    instances: Path | None


class CityscapesFolder(Sequence[LabelledFrame]):
    """The frames of one split, by ascending name. Each is read when needed.

    Args:
        root: folder with ``leftImg8bit`` and ``gtFine``.
        split: ``train``, ``val`` …

    Raises:
        NotFound: there is no such split, or a picture has no ``_gtFine_labelIds.png``.
    """

    def __init__(self, root: Path, split: str) -> None:
        self.root, self.split = root, split
        pictures = sorted((root / _PICTURE / split).glob(f"*/*_{_PICTURE}.*"))
        if not pictures:
            raise NotFound(f"picture of split {split!r} in", root / _PICTURE / split)
        self._entries = [self._entry(path) for path in pictures]

    @classmethod
    def splits(cls, root: Path) -> tuple[str, ...]:
        """Return the splits of which the folder has pictures."""
        return tuple(sorted(path.name for path in (root / _PICTURE).glob("*") if path.is_dir()))

    @property
    def names(self) -> tuple[FrameName, ...]:
        return tuple(entry.name for entry in self._entries)

    @property
    def has_instances(self) -> bool:
        """True if every frame has a map of instances."""
        return all(entry.instances is not None for entry in self._entries)

    def __len__(self) -> int:
        return len(self._entries)

    @overload
    def __getitem__(self, index: int) -> LabelledFrame: ...

    @overload
    def __getitem__(self, index: slice) -> list[LabelledFrame]: ...

    def __getitem__(self, index: int | slice) -> LabelledFrame | list[LabelledFrame]:
        """Read one or several frames.

        Raises:
            CorruptArtifact: a file is not a picture.
            InvalidInput: sizes differ, or Cityscapes has no such label id.
        """
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        entry = self._entries[index]
        class_map = _labels(entry.labels)
        require_label_ids(class_map, field=entry.labels.name)
        instance_map = np.zeros(class_map.shape, np.uint16)
        if entry.instances is not None:
            instance_map = _instances(entry.instances)
        return LabelledFrame(entry.name, _picture(entry.picture), class_map, instance_map)

    def instance_map(self, index: int) -> NDArray[np.uint16]:
        """Read only the instances of a frame, as in `LabelledFrame`.

        Raises:
            NotFound: the frame has no map of instances.
            CorruptArtifact: the file is not a picture.
        """
        entry = self._entries[index]
        if entry.instances is None:
            raise NotFound("instance ids of", entry.name)
        return _instances(entry.instances)

    def __iter__(self) -> Iterator[LabelledFrame]:
        return (self[i] for i in range(len(self)))

    def _entry(self, picture: Path) -> _Entry:
        name = FrameName.parse(picture.name)
        labels = self.root / labels_path(self.split, name, "labelIds.png")
        if not labels.is_file():
            raise NotFound("label ids of a picture:", labels)
        instances = self.root / labels_path(self.split, name, "instanceIds.png")
        return _Entry(name, picture, labels, instances if instances.is_file() else None)


class _Opened:
    """An open image file, with the errors of `valerie.errors`."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def __enter__(self) -> Image.Image:
        try:
            self._image = Image.open(self._path)
            self._image.load()
        except FileNotFoundError:
            raise NotFound("file", self._path) from None
        except (UnidentifiedImageError, OSError, Image.DecompressionBombError) as error:
            raise CorruptArtifact(f"{self._path.name} is not a readable picture ({error})") from error
        return self._image

    def __exit__(self, *_: object) -> None:
        self._image.close()


def _picture(path: Path) -> NDArray[np.uint8]:
    with _Opened(path) as image:
        return np.asarray(image.convert("RGB"), np.uint8)


def _labels(path: Path) -> NDArray[np.uint8]:
    return _ids(path, 255).astype(np.uint8)


def _instances(path: Path) -> NDArray[np.uint16]:
    ids = _ids(path, 65_535).astype(np.uint16)
    return np.where(ids >= 1000, ids, np.uint16(0))


def _ids(path: Path, largest: int) -> NDArray[np.integer]:
    with _Opened(path) as image:
        values = np.asarray(image)
    if values.ndim != 2 or values.dtype.kind not in "ui":
        raise InvalidInput("not a map of ids", field=path.name, value=f"{values.dtype} {values.shape}", limit="(H, W)")
    if values.size and (int(values.min()) < 0 or int(values.max()) > largest):
        raise InvalidInput("not a map of ids", field=path.name, value=int(values.max()), limit=largest)
    return values


def save_png(path: Path, pixels: NDArray[np.uint8] | NDArray[np.uint16]) -> None:
    """Write a PNG, and create its folders."""
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.ascontiguousarray(pixels)).save(path, "PNG", compress_level=3)


def _write_json(path: Path, document: object) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(document, indent=1) + "\n")
