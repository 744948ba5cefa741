"""torch modules of documents and their payloads: float pictures in, logits out."""

from __future__ import annotations

from pathlib import Path

from torch import nn

from valerie.perception.documents.function import FunctionDocument
from valerie.perception.importing.function_file import read_tensors
from valerie.perception.importing.network_weights import filled_network


def open_module(document: FunctionDocument, payload: Path) -> nn.Module:
    """Return the network of a document of kind ``network`` or ``huggingface``, fp32, in evaluation mode, without gradients.

    Returns:
        A module from (N, 3, H, W) float32, normalised and in the document's channel order, to logits (N, classes, h, w). Its
        attribute ``align_corners``, if present, determines how to upsample them.

    Raises:
        InvalidInput, UnknownName: document and payload do not fit each other.
        MissingDependency: transformers is not installed.
    """
    if document.kind == "huggingface":
        from valerie.perception.importing.huggingface import open_huggingface

        return open_huggingface(document, payload)
    classes = len(document.output.classes)
    return filled_network(document.architecture, read_tensors(payload), classes, field=payload.name)
