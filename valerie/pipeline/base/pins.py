"""Which numeric classes make a run's pixels: chosen once, from what living workers offer, and kept for all its products."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any, Final

from valerie.perception.base import FunctionCard
from valerie.perception.documents.function import FunctionDocument
from valerie.perception.documents.options import PredictionsOptions
from valerie.plugins import known_engine
from valerie.runs.documents import engine_name
from valerie.runs.states import UPLOADED_ROUTE

#: The name under which render workers offer the truth pass, beside their engines.
TRUTH: Final = "truth"


def choose_pins(
    spec: Mapping[str, Any],
    offers: Sequence[Mapping[str, Any]],
    registered: Mapping[str, FunctionDocument],
) -> tuple[dict[str, Any], None] | tuple[None, str]:
    """Pins for a run, or why there are none yet.

    Args:
        spec: the run's spec as a document (``renderer``, ``functions``).
        offers: {"stage", "name", "numeric_class", "route", "revision" | "digest"} of the living workers; an inference engine
            is offered as `inference_name` calls it.
        registered: those of the spec's functions that are registered, by what the spec calls them.

    Returns:
        ({"engine": offer, "truth": offer, "functions": {name: offer}}, None), or (None, reason in words). Where several
        numeric classes are offered, the one of the longest-serving worker is taken (``offers`` is in that order).
    """
    name = engine_name(spec["renderer"])
    engine = _first(offers, "render", name)
    truth = _first(offers, "render", TRUTH)
    functions = {name: _function(name, offers, registered.get(name)) for name in spec["functions"]}
    missing = []
    if engine is None:
        declared = known_engine(name)
        hint = f" ({declared.install_hint})" if declared is not None and declared.install_hint else ""
        missing.append(f"a render worker with the engine {name!r}{hint}")
    if truth is None:
        missing.append("a render worker with the truth pass")
    for function, offer in functions.items():
        if offer is None and function in registered:
            missing.append(
                f"an inference worker with {inference_name(registered[function])} (for the function {function!r})"
            )
        elif offer is None:
            missing.append(f"an inference worker with the function {function!r}")
    if missing:
        return None, "waiting for " + ", ".join(missing) + " (start one with: valerie worker)"
    return {"engine": engine, "truth": truth, "functions": functions}, None


def pinned_card(pins: Mapping[str, Any], name: str) -> FunctionCard:
    """The card of one of a run's functions, as pinned; ``name`` is what the spec calls it."""
    return FunctionCard(**pins["functions"][name]["card"])


def inference_name(document: FunctionDocument) -> str:
    """What workers must offer to run a registered function: ``openvino/bf16``, ``http``; no function has such a name."""
    return document.kind if document.engine == "none" else f"{document.engine}/{document.precision}"


def _function(
    name: str, offers: Sequence[Mapping[str, Any]], document: FunctionDocument | None
) -> dict[str, Any] | None:
    if document is None:
        return _first(offers, "infer", name)
    if document.kind == "predictions":
        # They are made elsewhere: nothing here could change a bit of them.
        offer: dict[str, Any] | None = {"numeric_class": "uploaded", "revision": 1, "route": UPLOADED_ROUTE}
    else:
        offer = _first(offers, "infer", inference_name(document))
    if offer is None:
        return None
    return {
        "stage": "infer",
        "name": name,
        "kind": document.kind,
        "digest": document.digest,
        "revision": offer["revision"],
        "numeric_class": offer["numeric_class"],
        "route": offer["route"],
        "card": asdict(replace(document.card(), name=name)),
        **(
            {"deadline_hours": options.deadline_hours}
            if isinstance(options := document.options, PredictionsOptions)
            else {}
        ),
    }


def _first(offers: Sequence[Mapping[str, Any]], stage: str, name: str) -> dict[str, Any] | None:
    return next((dict(offer) for offer in offers if offer["stage"] == stage and offer["name"] == name), None)
