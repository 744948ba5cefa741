"""Convert a checkpoint of another program to a function of ours: recognise, rename, check, and record assumptions."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
import torch
from numpy.typing import NDArray

from valerie.errors import InvalidInput, UnknownName
from valerie.perception.documents.class_maps import CLASS_LISTS
from valerie.perception.importing.checkpoints.checkpoint_files import (
    MAX_BYTES,
    StoredCheckpoint,
    read_stored_checkpoint,
)
from valerie.perception.importing.checkpoints.configuration import config_values
from valerie.perception.importing.checkpoints.layouts import LAYOUTS, Layout, PictureUnits, Tensors
from valerie.perception.importing.function_file import FORMAT as FUNCTION_FORMAT
from valerie.perception.importing.function_file import safetensors_bytes
from valerie.perception.importing.network_weights import (
    differing_tensors,
    filled_network,
    first_three,
    require_same_shapes,
    tensor_shapes,
)
from valerie.perception.networks.architectures import ARCHITECTURES, NetworkSettings
from valerie.perception.networks.deeplabv3plus import DeepLabSettings
from valerie.plain import JsonObject

#: ``format`` entry in the header of a payload; ``valerie train`` writes `FUNCTION_FORMAT`.
FORMAT: Final = "valerie-network/1"
_CITYSCAPES: Final = CLASS_LISTS["cityscapes"]
#: Settings in a configuration of mmsegmentation that tensors do not reveal.
_SETTINGS: Final = (
    "model.decode_head.align_corners",
    "model.backbone.multi_grid",
    "model.backbone.contract_dilation",
    "model.decode_head.dilations",
)

Shapes = Mapping[str, tuple[int, ...]]


@dataclass(frozen=True, slots=True)
class ImportedNetwork:
    """A network of ours with the weights of a checkpoint.

    Attributes:
        architecture: a name in `valerie.perception.networks.architectures`.
        classes: names in the order of the logits' channels.
        units: format of the pictures that the network expects.
        tensors: tensors by our names, float32 or float16 as in the checkpoint.
        provenance: origin, check, and assumptions about facts that the file does not state.
    """

    architecture: str
    classes: tuple[str, ...]
    units: PictureUnits
    tensors: Mapping[str, NDArray[np.floating]]
    provenance: Mapping[str, str]

    def payload(self) -> bytes:
        """Return the network with all entries as a safetensors file. Equal networks give equal bytes."""
        entries = {
            "format": FORMAT,
            "architecture": self.architecture,
            "classes": json.dumps(self.classes),
            "mean": json.dumps(self.units.mean),
            "std": json.dumps(self.units.std),
            "scale": self.units.scale,
            "channel_order": self.units.channel_order,
            "provenance": json.dumps(dict(self.provenance), sort_keys=True, ensure_ascii=False),
        }
        return safetensors_bytes(self.tensors, entries)

    def document_fields(self) -> JsonObject:
        """Return the entries of a `valerie.perception.documents.function.FunctionDocument` that follow from the checkpoint."""
        return {
            "kind": "network",
            "architecture": self.architecture,
            "input": {
                "mode": "pad",
                "multiple_of": 32,
                "mean": self.units.mean,
                "std": self.units.std,
                "scale": self.units.scale,
                "channel_order": self.units.channel_order,
            },
            "output": {"kind": "logits", "classes": self.classes},
            "provenance": dict(self.provenance),
        }


def import_checkpoint(
    path: Path, *, architecture: str | None = None, classes: Sequence[str] | None = None, max_bytes: int = MAX_BYTES
) -> ImportedNetwork:
    """Read a checkpoint of a known layout without running anything in it.

    Args:
        path: a file of torch.save, a pickle of numpy arrays, or safetensors.
        architecture: choice among architectures with the same tensors; None: the one that the file states, or the first.
        classes: names in the order of the channels; None: those that the file states, or the 19 of Cityscapes if there
            are 19.
        max_bytes: larger files are refused unread.

    Raises:
        NotFound: no such file.
        InvalidInput: the file is not readable, has no known layout (the nearest one and the first differing tensors are
            named), or fails the self-check.
        UnknownName: ``architecture``.
    """
    return convert(
        read_stored_checkpoint(path, max_bytes=max_bytes), field=path.name, architecture=architecture, classes=classes
    )


def convert(
    checkpoint: StoredCheckpoint, *, field: str, architecture: str | None = None, classes: Sequence[str] | None = None
) -> ImportedNetwork:
    """Convert a stored checkpoint; see `import_checkpoint`."""
    if architecture is not None and architecture not in ARCHITECTURES:
        raise UnknownName("architecture", architecture, ARCHITECTURES, field="architecture")
    if checkpoint.entries.get("format") in (FORMAT, FUNCTION_FORMAT):
        imported = _own(checkpoint, field)
        if architecture not in (None, imported.architecture):
            raise InvalidInput(
                "the file holds another architecture", field=field, value=imported.architecture, limit=architecture
            )
    else:
        imported = _foreign(checkpoint, field, architecture)
    if classes is not None:
        imported = replace(imported, classes=_fitting(tuple(classes), len(imported.classes), field))
    _self_check(imported, field)
    return imported


def _own(checkpoint: StoredCheckpoint, field: str) -> ImportedNetwork:
    entries = {name: str(value) for name, value in checkpoint.entries.items()}
    reserved = ("format", "architecture", "classes", "mean", "std", "scale", "channel_order", "provenance")
    missing = [name for name in reserved[:5] if name not in entries]
    if missing:
        raise InvalidInput("entries of the header are missing", field=field, value=", ".join(missing))
    try:
        classes, mean, std = (json.loads(entries[name]) for name in ("classes", "mean", "std"))
        stated = json.loads(entries.get("provenance", "{}"))
        scale, order = entries.get("scale", "1/255"), entries.get("channel_order", "rgb")
        units = _units(mean, std, "1" if scale == "1" else "1/255", "bgr" if order == "bgr" else "rgb", field)
        names = tuple(str(name) for name in classes)
        provenance = {str(name): str(text) for name, text in stated.items()}
    except (ValueError, TypeError, AttributeError) as error:
        raise InvalidInput(f"the header cannot be read ({error})", field=field) from None
    provenance |= {name: text for name, text in entries.items() if name not in reserved}
    architecture = entries["architecture"]
    require_same_shapes(tensor_shapes(architecture, len(names)), _shapes(checkpoint.tensors), field=field)
    provenance = {"layout": "VALERIE", "checked": "own format", "source": field, **provenance}
    return ImportedNetwork(architecture, names, units, _floating(checkpoint.tensors, field), provenance)


def _foreign(checkpoint: StoredCheckpoint, field: str, preference: str | None) -> ImportedNetwork:
    layout, fitting, count = _recognise(_shapes(checkpoint.tensors), field, preference)
    config = config_values(checkpoint.entries)
    architecture, assumed = _choose(fitting, config, preference, field)
    names = {name: layout.name_of(name) for name in tensor_shapes(architecture, count)}
    theirs = _floating({name: checkpoint.tensors[name] for name in names.values()}, field)
    tensors = layout.reorder({ours: theirs[name] for ours, name in names.items()}, architecture)
    classes, classes_stated = _classes(checkpoint.entries, count, field)
    units, units_stated = _units_of(layout, checkpoint, config, field)
    if not classes_stated:
        assumed.append("classes: the 19 of Cityscapes" if classes == _CITYSCAPES else "classes: without names")
    if not units_stated:
        assumed.append("normalisation: the program's usual one")
    provenance = {
        "layout": layout.name,
        "program": f"{layout.source} ({layout.licence})",
        "source": field,
        "checked": "logits",
    }
    if assumed:
        provenance["assumed"] = "; ".join(assumed)
    return ImportedNetwork(architecture, classes, units, tensors, provenance)


def _recognise(shapes: Shapes, field: str, preference: str | None) -> tuple[Layout, list[str], int]:
    """Return the layout, its architectures with exactly these tensors, and the number of classes."""
    layouts = [layout for layout in LAYOUTS if preference is None or preference in layout.architectures]
    if not layouts:
        raise InvalidInput("no layout has this architecture", field="architecture", value=preference)
    nearest: list[tuple[int, str, list[str]]] = []
    # Looking for the classifier first avoids building every network for every file.
    for layout in [each for each in layouts if _classifier(each) in shapes] or layouts:
        weights = {name: shape for name, shape in shapes.items() if not name.startswith(layout.ignored)}
        shape = shapes.get(_classifier(layout))
        count = shape[0] if shape else len(_CITYSCAPES)
        fitting = []
        for architecture in layout.architectures if preference is None else (preference,):
            problems = differing_tensors(_their_shapes(layout, architecture, count), weights)
            if not problems:
                fitting.append(architecture)
            nearest.append((len(problems), f"{layout.name}, {architecture}", problems))
        if fitting:
            return layout, fitting, count
    _, name, problems = min(nearest, key=lambda each: each[0])
    raise InvalidInput(f"no known layout; the nearest is {name}, but {first_three(problems)}", field=field)


def _classifier(layout: Layout) -> str:
    module = "classifier" if "classifier" in layout.modules else "predictor"
    return f"{layout.modules[module]}.weight"


@lru_cache(maxsize=64)
def _shapes_of(architecture: str, count: int) -> Shapes:
    return tensor_shapes(architecture, count)


def _their_shapes(layout: Layout, architecture: str, count: int) -> dict[str, tuple[int, ...]]:
    return {layout.name_of(name): shape for name, shape in _shapes_of(architecture, count).items()}


def _choose(fitting: list[str], config: JsonObject, preference: str | None, field: str) -> tuple[str, list[str]]:
    """Return one of several architectures with the same tensors, and the assumptions behind the choice."""
    if preference is not None:
        return preference, []
    if "model.decode_head.align_corners" in config:
        agreeing = [name for name in fitting if _agree(ARCHITECTURES[name], config)]
        if not agreeing:
            settings = ", ".join(
                f"{name.removeprefix('model.')}={config[name]}" for name in _SETTINGS if name in config
            )
            raise InvalidInput(
                "the settings in the file fit no architecture", field=field, value=settings, limit=fitting
            )
        return agreeing[0], []
    if len(fitting) == 1:
        return fitting[0], []
    return fitting[0], [f"architecture: the tensors are also those of {', '.join(fitting[1:])}"]


def _agree(settings: NetworkSettings, config: JsonObject) -> bool:
    """Return True if an architecture agrees with a configuration of mmsegmentation in settings that tensors do not reveal."""
    values = (config.get(name) for name in _SETTINGS)
    aligned, grid, contract, rates = (tuple(value) if isinstance(value, list) else value for value in values)
    if not isinstance(settings, DeepLabSettings):
        return not aligned
    return (
        bool(aligned) == settings.align_corners
        and grid == settings.backbone.last_dilations
        and contract is not False
        and (rates is None or rates == (1, *settings.rates))
    )


def _classes(entries: JsonObject, count: int, field: str) -> tuple[tuple[str, ...], bool]:
    """Return the names of the classes, and True if the file states them."""
    for place in ("meta.CLASSES", "meta.dataset_meta.classes", "meta.dataset_meta.CLASSES"):
        names = entries.get(place)
        if isinstance(names, list | tuple) and all(isinstance(name, str) for name in names):
            return _fitting(tuple(names), count, f"{field}: {place}"), True
    if count == len(_CITYSCAPES):
        return _CITYSCAPES, False
    return tuple(f"class-{number}" for number in range(count)), False


def _fitting(classes: tuple[str, ...], count: int, field: str) -> tuple[str, ...]:
    if len(classes) != count:
        raise InvalidInput(
            "not one class per channel",
            field=field,
            value=f"{len(classes)} classes",
            limit=count,
        )
    return classes


def _units_of(
    layout: Layout, checkpoint: StoredCheckpoint, config: JsonObject, field: str
) -> tuple[PictureUnits, bool]:
    """Return the units of the layout, updated with those in the file, and True if the file states any."""
    usual = layout.units
    for place, flag in (
        ("data_preprocessor", "bgr_to_rgb"),
        ("model.data_preprocessor", "bgr_to_rgb"),
        ("img_norm_cfg", "to_rgb"),
    ):
        if f"{place}.mean" in config and f"{place}.std" in config:
            # mmcv reads pictures blue first; False leaves them so.
            order = "bgr" if config.get(f"{place}.{flag}") is False else usual.channel_order
            return _units(config[f"{place}.mean"], config[f"{place}.std"], usual.scale, order, field), True
    if "pixel_mean" in checkpoint.tensors and "pixel_std" in checkpoint.tensors:
        # Converted by their digits: 123.675 as float32 is not 123.675 as float64.
        mean, std = ([float(str(x)) for x in checkpoint.tensors[f"pixel_{name}"].ravel()] for name in ("mean", "std"))
        return _units(mean, std, usual.scale, usual.channel_order, field), True
    return usual, False


def _units(
    mean: object, std: object, scale: Literal["1", "1/255"], order: Literal["rgb", "bgr"], field: str
) -> PictureUnits:
    return PictureUnits(_triple(mean, "mean", field), _triple(std, "std", field), scale, order)


def _triple(values: object, name: str, field: str) -> tuple[float, float, float]:
    numbers = [float(x) for x in values if isinstance(x, int | float)] if isinstance(values, list | tuple) else []
    if len(numbers) != 3 or not np.isfinite(numbers).all() or (name == "std" and min(numbers) <= 0.0):
        limit = "three positive numbers" if name == "std" else "three numbers"
        raise InvalidInput("not the statistics of three channels", field=f"{field}: {name}", value=values, limit=limit)
    return numbers[0], numbers[1], numbers[2]


def _shapes(tensors: Mapping[str, NDArray[Any]]) -> dict[str, tuple[int, ...]]:
    return {name: tuple(array.shape) for name, array in tensors.items()}


def _floating(tensors: Mapping[str, NDArray[Any]], field: str) -> Tensors:
    """Return the tensors as float32, or float16 if stored so; batch counters are left out."""
    floating: Tensors = {}
    for name, array in tensors.items():
        if name.endswith(".num_batches_tracked"):
            continue
        if not np.issubdtype(array.dtype, np.floating):
            raise InvalidInput("not floating point", field=f"{field}: {name}", value=str(array.dtype))
        dtype = np.float16 if array.dtype == np.float16 else np.float32
        values: NDArray[np.floating] = np.ascontiguousarray(array, dtype)
        if not np.isfinite(values).all():
            raise InvalidInput("holds values that are not finite", field=f"{field}: {name}")
        floating[name] = values
    return floating


def _self_check(imported: ImportedNetwork, field: str) -> None:
    """Check that the network accepts the tensors and returns finite logits for a fixed picture."""
    count = len(imported.classes)
    network = filled_network(imported.architecture, imported.tensors, count, field=field)
    values = torch.linspace(-2.0, 2.0, 3 * 64 * 96).reshape(1, 3, 64, 96)
    with torch.inference_mode():
        logits = network(values)
    if tuple(logits.shape) != (1, count, 64 // network.stride, 96 // network.stride):
        raise InvalidInput("logits of another shape", field=field, value=list(logits.shape), limit=count)
    if not torch.isfinite(logits).all():
        raise InvalidInput("the network does not give finite logits", field=field)
