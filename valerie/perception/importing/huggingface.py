"""Semantic segmentation networks of Hugging Face transformers from local folders: no download, no foreign code, no pickle."""

from __future__ import annotations

import hashlib
import json
import warnings
from collections.abc import Collection, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Final, NotRequired, TypedDict

from valerie.errors import InvalidInput, NotFound
from valerie.perception.documents.function import FunctionDocument, parse_function
from valerie.perception.documents.options import HuggingFaceOptions
from valerie.plain import Json, JsonObject

if TYPE_CHECKING:
    from torch import nn

_CONFIG: Final = "config.json"
_WEIGHTS: Final = "model.safetensors"
_PROCESSOR: Final = "preprocessor_config.json"
_MAX_JSON_BYTES: Final = 1 << 20
#: Defaults of these image processors, for files that do not state them.
_MEAN, _STD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)


def read_huggingface(folder: Path, name: str, **changes: Json) -> tuple[FunctionDocument, Path]:
    """Return document and payload of a folder that `save_pretrained` wrote, without loading torch or transformers.

    The classes come from the configuration, size and normalisation from the image processor's file.

    Args:
        folder: folder with config.json, model.safetensors and usually preprocessor_config.json.
        name: name of the function.
        changes: entries that override the folder's, e.g. ``input`` or ``output``; mappings are merged.

    Raises:
        NotFound: the folder or one of its files is missing.
        InvalidInput: the weights have another format or several files, or the document does not fit.
    """
    if not folder.is_dir():
        raise NotFound("folder", folder.name)
    config = _json(folder / _CONFIG)
    weights = folder / _WEIGHTS
    if not weights.is_file():
        others = sorted(path.name for pattern in ("*.bin", "*.safetensors*", "*.pt") for path in folder.glob(pattern))
        raise InvalidInput(
            "the weights must be one safetensors file: load the model and save it again with save_pretrained",
            field=folder.name,
            value=", ".join(others) or "none",
            limit=_WEIGHTS,
        )
    with weights.open("rb") as stream:
        digest = hashlib.file_digest(stream, "sha256").hexdigest()
    processor = _json(folder / _PROCESSOR) if (folder / _PROCESSOR).exists() else {}
    values: JsonObject = {
        "name": name,
        "kind": "huggingface",
        "architecture": str(config.get("model_type", "")),
        "options": {"config": config},
        "input": _input(processor),
        "output": {"classes": _classes(config, folder.name)},
        "provenance": {"source": f"transformers folder {folder.name}"},
    }
    for entry, change in changes.items():
        own = values.get(entry)
        if isinstance(change, Mapping) and isinstance(own, dict):
            values[entry] = {**own, **change}
        else:
            values[entry] = change
    payload = {"sha256": digest, "bytes": weights.stat().st_size, "format": "safetensors"}
    return parse_function(values, payload=payload), weights


def open_huggingface(document: FunctionDocument, payload: Path) -> nn.Module:
    """Return the network of a document of kind ``huggingface``; see `valerie.perception.running.engines.modules.open_module`.

    Raises:
        InvalidInput: transformers does not know the model type as semantic segmentation, or the weights differ from those of
            the configuration; names the first differences.
        ModuleNotFoundError: transformers is not installed.
    """
    import torch
    import transformers
    from torch import nn

    assert isinstance(document.options, HuggingFaceOptions), "the document's kind is huggingface"

    class Logits(nn.Module):
        def __init__(self, model: Any) -> None:
            super().__init__()
            self.model = model

        def forward(self, x: torch.Tensor) -> torch.Tensor:
            logits: torch.Tensor = self.model(pixel_values=x).logits
            return logits

    transformers.logging.set_verbosity_error()  # type: ignore[no-untyped-call]
    transformers.logging.disable_progress_bar()  # type: ignore[no-untyped-call]
    # from_pretrained reads only folders, with fixed file names.
    with TemporaryDirectory(prefix="valerie-huggingface-") as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # deprecations within the library
        (Path(folder) / _CONFIG).write_text(json.dumps(document.options.config), "utf-8")
        (Path(folder) / _WEIGHTS).symlink_to(payload.absolute())
        try:
            model, report = transformers.AutoModelForSemanticSegmentation.from_pretrained(
                folder,
                local_files_only=True,
                use_safetensors=True,
                trust_remote_code=False,
                output_loading_info=True,
                dtype=torch.float32,
                attn_implementation="eager",
            )
        except Exception as error:  # a wrong configuration may fail in any way
            reason = str(error).strip().partition("\n")[0]
            raise InvalidInput(f"transformers cannot open it: {reason}", field=document.name) from error
    _require_complete(report, document.name)
    classes = int(model.config.num_labels)
    if classes != len(document.output.classes):
        raise InvalidInput(
            "the network has another number of classes",
            field="output.classes",
            value=len(document.output.classes),
            limit=classes,
        )
    model.requires_grad_(requires_grad=False)
    return Logits(model).eval()


class _LoadingReport(TypedDict):
    """The report of transformers on a loaded model."""

    missing_keys: Collection[str]
    unexpected_keys: Collection[str]
    mismatched_keys: Collection[tuple[str, object, object]]
    error_msgs: NotRequired[Collection[str]]


def _require_complete(report: _LoadingReport, field: str) -> None:
    """Refuse incomplete weights: transformers draws missing ones at random, with only a warning."""
    problems = [f"{name} is missing" for name in sorted(report["missing_keys"])]
    problems += [f"{name} is unknown" for name in sorted(report["unexpected_keys"])]
    problems += [f"{name} has another shape" for name in sorted(name for name, *_ in report["mismatched_keys"])]
    problems += [str(message) for message in report.get("error_msgs", [])]
    if problems:
        from valerie.perception.importing.network_weights import first_three

        raise InvalidInput(f"the weights are not those of the configuration: {first_three(problems)}", field=field)


def _classes(config: JsonObject, field: str) -> list[str]:
    names = config.get("id2label")
    if not isinstance(names, dict) or not names:
        raise InvalidInput("the configuration names no classes", field=f"{field}: {_CONFIG}: id2label")
    try:
        numbered = {int(number): str(name) for number, name in names.items()}
    except ValueError:
        numbered = {}
    if sorted(numbered) != list(range(len(names))):
        raise InvalidInput("class ids are not 0, 1, 2 …", field=f"{field}: {_CONFIG}: id2label", value=", ".join(names))
    return [numbered[number] for number in range(len(numbered))]


def _input(processor: JsonObject) -> JsonObject:
    entries: JsonObject = {"multiple_of": 32}
    size = processor.get("size")
    if processor.get("do_resize", True) and isinstance(size, dict) and {"height", "width"} <= set(size):
        entries = {"mode": "resize", "size": [size["width"], size["height"]]}
    if processor.get("do_normalize", True):
        entries["mean"] = processor.get("image_mean", _MEAN)
        entries["std"] = processor.get("image_std", _STD)
    entries["scale"] = processor.get("rescale_factor", 1 / 255) if processor.get("do_rescale", True) else 1
    return entries


def _json(path: Path) -> JsonObject:
    try:
        if path.stat().st_size > _MAX_JSON_BYTES:
            raise InvalidInput("the file is too large", field=path.name, limit=f"{_MAX_JSON_BYTES} bytes")
        document = json.loads(path.read_bytes())
    except FileNotFoundError:
        raise NotFound("file", f"{path.parent.name}/{path.name}") from None
    except (ValueError, RecursionError):
        raise InvalidInput("not JSON", field=path.name) from None
    if not isinstance(document, dict):
        raise InvalidInput("not a JSON mapping", field=path.name)
    return document
