"""Choose the numeric classes of a run once, from the offers of living workers, for all its products."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Final, NamedTuple, TypeVar

from sqlalchemy import Connection

from valerie.analysis.rows.design import position_paths
from valerie.db import processes
from valerie.parameters.space import ParameterSpace
from valerie.perception.base import FunctionCard
from valerie.perception.documents.function import FunctionDocument
from valerie.perception.documents.options import PredictionsOptions
from valerie.plugins import known_engine
from valerie.runs.document.run_spec import Reproducible
from valerie.runs.products.pins import (
    BOUNDS,
    TRUTH,
    FunctionOffer,
    FunctionPin,
    InferClass,
    Offer,
    Pins,
    RenderClass,
    TolerantPins,
)
from valerie.runs.products.specimens import agree, specimen_key
from valerie.runs.products.states import UPLOADED_ROUTE, Stage
from valerie.runs.resolving.spec import RunSpec
from valerie.statistics.units import LISTED

StageClass = TypeVar("StageClass", RenderClass, InferClass)

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
        pin = _function(name, offers, document)
        if pin is not None:
            functions[name] = pin
        elif document is None:
            missing.append(f"an inference worker with the function {name!r}")
        else:
            missing.append(f"an inference worker with {inference_name(document)} (for the function {name!r})")
    if engine is None or truth is None or missing:
        return PinChoice(None, "waiting for " + ", ".join(missing) + " (start one with: valerie worker)")
    return PinChoice(Pins(engine=engine, truth=truth, functions=functions), None)


def pins_for(
    connection: Connection,
    spec: RunSpec,
    by_worker: Sequence[Sequence[Offer]],
    registered: Mapping[str, FunctionDocument],
    space: Callable[[], ParameterSpace],
) -> PinChoice:
    """Choose the pins for a run: one numeric class of each part, or with ``reproducible: tolerance`` all that agree.

    Args:
        connection: to read specimens with.
        spec, registered: as for `choose_pins`.
        by_worker: the offers of each living worker, longest-serving first.
        space: returns the variants of the run.
    """
    offers = processes.distinct(by_worker)
    choice = choose_pins(spec, offers, registered)
    if choice.pins is None or spec.reproducible is Reproducible.BITS:
        return choice
    specimens = processes.stored_specimens(connection, [specimen_key(offer) for offer in offers])
    return PinChoice(agreeing_pins(choice.pins, spec, by_worker, registered, space(), specimens), None)


def agreeing_pins(
    first: Pins,
    spec: RunSpec,
    by_worker: Sequence[Sequence[Offer]],
    registered: Mapping[str, FunctionDocument],
    space: ParameterSpace,
    specimens: Mapping[str, bytes],
) -> TolerantPins:
    """Return pins that accept each worker that has all that a run needs of its stage in classes that agree with the first.

    Args:
        first: the pins that `choose_pins` returns.
        spec, by_worker, registered: as for `pins_for`.
        space: the variants of the run.
        specimens: specimens of the offers by `specimen_key`.
    """
    models = {(offer.stage, offer.name): offer for offers in reversed(by_worker) for offer in offers}
    render = [RenderClass(engine=first.engine, truth=first.truth, workers=0)]
    infer = [InferClass(functions=_inferred(first.functions), workers=0)]
    for offers in by_worker:
        alike = [offer for offer in offers if agree(models[offer.stage, offer.name], offer, specimens, BOUNDS)]
        engine, truth = _first(alike, Stage.RENDER, spec.engine), _first(alike, Stage.RENDER, TRUTH)
        if engine is not None and truth is not None:
            render.append(RenderClass(engine=engine, truth=truth, workers=1))
        pins = {name: _function(name, alike, registered.get(name)) for name in spec.functions}
        functions = {name: pin for name, pin in pins.items() if pin is not None}
        if len(functions) == len(pins):
            infer.append(InferClass(functions=_inferred(functions), workers=1))
    return TolerantPins(
        **dict(first), render=_counted(render), infer=_counted(infer), place=place_paths(space), bounds=BOUNDS
    )


def place_paths(space: ParameterSpace) -> tuple[str, ...]:
    """Return the paths whose values make a place; a drawn variant is its own."""
    listed = any(block.design in LISTED for block in space.blocks)
    return position_paths(space.varied) if listed else space.varied


def _inferred(functions: Mapping[str, FunctionPin]) -> dict[str, FunctionPin]:
    return {name: pin for name, pin in functions.items() if pin.route != UPLOADED_ROUTE}


def _counted(classes: Iterable[StageClass]) -> tuple[StageClass, ...]:
    """Return each class once with the number of its workers, sorted by queue."""
    same: defaultdict[tuple[str, ...], list[StageClass]] = defaultdict(list)
    for one in classes:
        same[one.routes].append(one)
    return tuple(
        equal[0].model_copy(update={"workers": max(1, sum(one.workers for one in equal))})
        for _, equal in sorted(same.items())
    )


def pinned_card(pins: Pins, name: str) -> FunctionCard:
    """Return the card of one of a run's functions by its name in the spec."""
    return pins.functions[name].card


def inference_name(document: FunctionDocument) -> str:
    """Return the offer that a registered function needs: ``openvino/bf16``, ``http``; no function has such a name."""
    return document.kind if document.engine == "none" else f"{document.engine}/{document.precision}"


def _function(name: str, offers: Sequence[Offer], document: FunctionDocument | None) -> FunctionPin | None:
    return _installed(name, offers) if document is None else _registered(name, offers, document)


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
