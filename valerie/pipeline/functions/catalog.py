"""What a user can ask for: assets, engines, functions; with what living workers offer."""

from __future__ import annotations

import time
from dataclasses import asdict
from typing import Any, Final

from valerie import plugins
from valerie.db import processes
from valerie.db.engine import reading
from valerie.errors import ValerieError
from valerie.perception.base import FunctionCard
from valerie.perception.catalog import FUNCTIONS, function_card, function_document
from valerie.perception.documents.cards import card_rows
from valerie.perception.documents.function import FunctionDocument
from valerie.pipeline.base.context import Context
from valerie.pipeline.base.pins import inference_name
from valerie.pipeline.functions import registry
from valerie.runs.pins import FunctionOffer, Offer
from valerie.runs.states import Stage
from valerie.scene.assets.asset import asset_manifest, asset_names
from valerie.settings import Settings

#: What only registered functions have.
_NOT_REGISTERED: Final = dict.fromkeys(("reference", "version", "created_at"))


def assets(settings: Settings) -> list[dict[str, Any]]:
    """Name, title, digest and cameras of every asset; one that cannot be read says why in ``problem``."""
    found: list[dict[str, Any]] = []
    for name in asset_names(settings.asset_dir):
        try:
            manifest, digest = asset_manifest(name, asset_dir=settings.asset_dir)
        except ValerieError as error:
            found.append({"name": name, "title": "", "digest": "", "cameras": [], "problem": str(error)})
            continue
        cameras = list(manifest.cameras)
        found.append({"name": name, "title": manifest.title, "digest": digest, "cameras": cameras, "problem": None})
    return found


def asset(settings: Settings, name: str) -> dict[str, Any]:
    """The manifest of an asset without its outlines: parameters, cameras, persons, what moves.

    Raises:
        UnknownName: no such asset.
    """
    manifest, digest = asset_manifest(name, asset_dir=settings.asset_dir)
    document = manifest.model_dump(mode="json", exclude={"obstacles", "ground"})
    return {"digest": digest, **document}


def renderers(context: Context) -> list[dict[str, Any]]:
    """Engines, and the numeric classes in which living workers offer them."""
    offers = _offers(context, Stage.RENDER)
    return [
        {"name": name, "numeric_classes": sorted({o.numeric_class for o in offers if o.name == name})}
        for name in plugins.renderer_names()
    ]


def functions(context: Context) -> list[dict[str, Any]]:
    """Functions under test with their cards, and the numeric classes in which living workers offer them.

    First those that are installed, then those that are registered: every version, by name, newest first. One whose file is
    missing or damaged says so in ``problem``.
    """
    offers = _offers(context, Stage.INFER)
    found = []
    for name in plugins.function_names():
        offered = next((o.card for o in offers if isinstance(o, FunctionOffer) and o.name == name), None)
        card, document, problem = offered or FunctionCard(name, "", "", "", "", {}), None, None
        if name in FUNCTIONS:
            try:
                card, document = function_card(name), function_document(name)
            except ValerieError as error:
                problem = str(error)
        classes = sorted({o.numeric_class for o in offers if o.name == name})
        told = _told(card, document)
        found.append({**told, **_NOT_REGISTERED, "numeric_classes": classes, "problem": problem})
    with reading(context.engine) as connection:
        found += [_registered(one, offers) for one in registry.listed(connection)]
    return found


def function(context: Context, reference: str) -> dict[str, Any]:
    """One function: an installed one by its name, or a version of a registered one with its document.

    Raises:
        UnknownName, NotFound, InvalidInput: as `valerie.pipeline.functions.registry.find`.
    """
    if reference in plugins.function_names():
        return next(one for one in functions(context) if one["name"] == reference)
    with reading(context.engine) as connection:
        found = registry.find(connection, reference)
    return registered_function(context, found)


def registered_function(context: Context, found: registry.Registered) -> dict[str, Any]:
    """A version with its card, its document, and the numeric classes in which living workers offer its engine."""
    document = found.document.model_dump(mode="json")
    return {**_registered(found, _offers(context, Stage.INFER)), "document": document}


def _registered(found: registry.Registered, offers: list[Offer]) -> dict[str, Any]:
    document = found.document
    return {
        **_told(document.card(), document),
        "reference": found.reference,
        "version": found.version,
        "created_at": found.created_at.isoformat(),
        "numeric_classes": sorted({o.numeric_class for o in offers if o.name == inference_name(document)}),
        "problem": None,
    }


def _told(card: FunctionCard, document: FunctionDocument | None) -> dict[str, Any]:
    """What a function says of itself: a class of an installed package has no document, and says less."""
    return {
        **asdict(card),
        "kind": document and document.kind,
        "classes": document and list(document.output.reached),
        "unmapped": document and list(document.output.unmapped),
        "card": card_rows(card, document),
    }


def _offers(context: Context, stage: Stage) -> list[Offer]:
    with reading(context.engine) as connection:
        return [offer for offer in processes.offers(connection, now=time.time()) if offer.stage is stage]
