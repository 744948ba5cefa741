"""Rows of a function's card, the same in the terminal, over REST and on the dashboard."""

from __future__ import annotations

from typing import Final

from valerie.labels import TRAIN_NAMES
from valerie.perception.base import FunctionCard
from valerie.perception.documents.function import FunctionDocument, InputDocument, OutputDocument
from valerie.perception.documents.options import HttpOptions, PredictionsOptions
from valerie.perception.documents.training_data import trained_on

CardRow = tuple[str, str]

_ANSWERS: Final = {"logits": "logits", "probabilities": "probabilities", "labels": "ids of classes"}


def card_rows(card: FunctionCard, document: FunctionDocument | None = None) -> list[CardRow]:
    """Return title and text of all facts about a function, the most important first.

    Empty facts have no row. The function's machine and registered version are not listed.

    Args:
        card: card of the function.
        document: its document; None for a class of an installed package, which has only a card.
    """
    rows = [
        ("digest", card.digest),
        ("kind", document.kind if document else ""),
        ("architecture", document.architecture if document else card.architecture),
        *(_answers(document.output) if document else ()),
        ("judged by", ", ".join(card.judged_by)),
        *(_takes(document.input) if document and document.payload else ()),
        *(_elsewhere(document) if document else ()),
        ("engine", "" if card.engine == "none" else card.engine),
        ("precision", "" if card.engine == "none" else card.precision),
        ("file", _file(document)),
        ("trained on", _trained_on(document)),
        *sorted(card.provenance.items()),
    ]
    return [(title, text) for title, text in rows if text]


def _answers(part: OutputDocument) -> list[CardRow]:
    cut = f"; above {part.cut:g} a pixel is of the class" if len(part.classes) == 1 and part.kind != "labels" else ""
    return [
        ("classes", f"{len(part.classes)}: {', '.join(_class_texts(part))}"),
        ("answers", _ANSWERS[part.kind] + cut),
    ]


def _class_texts(part: OutputDocument) -> list[str]:
    """Return the names of the function's own classes, with an arrow to the evaluated class if their names differ."""
    targets = [TRAIN_NAMES[train_id] for train_id in part.lookup[: len(part.classes)].tolist()]
    return [own if own == name else f"{own} → {name}" for own, name in zip(part.classes, targets, strict=True)]


def _takes(part: InputDocument) -> list[CardRow]:
    side = part.longest_side
    reduced = "" if side is None else f"frames with a side longer than {side} pixels are reduced to it first"
    return [
        ("input size", _size(part)),
        ("reduction", reduced),
        ("normalisation", _normalisation(part)),
        ("channel order", part.channel_order.upper()),
    ]


def _size(part: InputDocument) -> str:
    if part.size is None:
        padded = "" if part.multiple_of == 1 else f", padded to multiples of {part.multiple_of}"
        return f"the frame's own{padded}"
    size = "{} × {}".format(*part.size)
    return {
        "pad": f"{size}: smaller frames are padded",
        "resize": f"{size}: frames are resized",
        "tile": f"{size}: tiles that share at least {part.overlap} pixels",
    }[part.mode]


def _normalisation(part: InputDocument) -> str:
    value = "x" if part.scale == "1" else "x / 255"
    if part.mean == (0.0, 0.0, 0.0) and part.std == (1.0, 1.0, 1.0):
        return value
    mean, std = (", ".join(f"{number:g}" for number in values) for values in (part.mean, part.std))
    return f"({value} − mean) / std, mean {mean}, std {std}"


def _elsewhere(document: FunctionDocument) -> list[CardRow]:
    options = document.options
    if isinstance(options, HttpOptions):
        limit = f"{options.timeout_s:g} s per picture"
        return [("address", options.url), ("time limit", limit), ("version of the endpoint", options.version)]
    if isinstance(options, PredictionsOptions) and options.deadline_hours is not None:
        return [("deadline", f"{options.deadline_hours:g} hours after the start of a run")]
    return []


def _trained_on(document: FunctionDocument | None) -> str:
    return ", ".join(f"{name} {part}".strip() for name, part in trained_on(document).items()) if document else ""


def _file(document: FunctionDocument | None) -> str:
    if document is None or document.payload is None:
        return ""
    return f"{document.payload.format}, {document.payload.bytes:,} bytes"
