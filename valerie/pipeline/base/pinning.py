"""Choose the numeric classes of a run once, from the offers of living workers, for all its products."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final, NamedTuple

from valerie.perception.base import FunctionCard
from valerie.perception.documents.function import FunctionDocument
from valerie.perception.documents.options import PredictionsOptions
from valerie.plugins import known_engine
from valerie.runs.products.pins import TRUTH, FunctionOffer, FunctionPin, Offer, Pins
from valerie.runs.products.states import UPLOADED_ROUTE, Stage
from valerie.runs.resolving.spec import RunSpec

#: Uploaded predictions are made elsewhere; nothing here can change them.
_UPLOADED: Final = Offer(stage=Stage.INFER, name="uploaded", numeric_class="uploaded", revision=1, route=UPLOADED_ROUTE)


class PinChoice(NamedTuple):
    """Pins for a run, or the reason why there are none yet."""

    pins: Pins | None
    reason: str | None


def choose_pins(spec: RunSpec, offers: Sequence[Offer], registered: Mapping[str, FunctionDocument]) -> PinChoice:
    """Choose the pins for a run.

    Args:
        spec: spec of the run.
        offers: offers of the living workers, longest-serving first; the first numeric class is taken.
        registered: documents of the spec's registered functions, by the names that the spec uses.
    """
    engine = _first(offers, Stage.RENDER, spec.engine)
    truth = _first(offers, Stage.RENDER, TRUTH)
    functions: dict[str, FunctionPin] = {}
    missing = []
    if engine is None:
        declared = known_engine(spec.engine)
        hint = f" ({declared.install_hint})" if declared is not None and declared.install_hint else ""
        missing.append(f"a render worker with the engine {spec.engine!r}{hint}")
    if truth is None:
        missing.append("a render worker with the truth pass")
    for name in spec.functions:
        document = registered.get(name)
        pin = _installed(name, offers) if document is None else _registered(name, offers, document)
        if pin is not None:
            functions[name] = pin
        elif document is None:
            missing.append(f"an inference worker with the function {name!r}")
        else:
            missing.append(f"an inference worker with {inference_name(document)} (for the function {name!r})")
    if engine is None or truth is None or missing:
        return PinChoice(None, "waiting for " + ", ".join(missing) + " (start one with: valerie worker)")
    return PinChoice(Pins(engine=engine, truth=truth, functions=functions), None)


def pinned_card(pins: Pins, name: str) -> FunctionCard:
    """Return the card of one of a run's functions by its name in the spec."""
    return pins.functions[name].card


def inference_name(document: FunctionDocument) -> str:
    """Return the offer that a registered function needs: ``openvino/bf16``, ``http``; no function has such a name."""
    return document.kind if document.engine == "none" else f"{document.engine}/{document.precision}"


def _installed(name: str, offers: Sequence[Offer]) -> FunctionPin | None:
    offer = _first(offers, Stage.INFER, name)
    return FunctionPin(**dict(offer)) if isinstance(offer, FunctionOffer) else None


def _registered(name: str, offers: Sequence[Offer], document: FunctionDocument) -> FunctionPin | None:
    options = document.options if isinstance(document.options, PredictionsOptions) else None
    offer = _first(offers, Stage.INFER, inference_name(document)) if options is None else _UPLOADED
    if offer is None:
        return None
    return FunctionPin(
        stage=Stage.INFER,
        name=name,
        numeric_class=offer.numeric_class,
        revision=offer.revision,
        route=offer.route,
        digest=document.digest,
        card=replace(document.card(), name=name),
        kind=document.kind,
        deadline_hours=None if options is None else options.deadline_hours,
    )


def _first(offers: Sequence[Offer], stage: Stage, name: str) -> Offer | None:
    return next((offer for offer in offers if offer.stage is stage and offer.name == name), None)
