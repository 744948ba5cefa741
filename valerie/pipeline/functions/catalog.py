"""The catalog of a deployment: assets, render engines and functions that a spec may name, with the offers of living workers."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from datetime import datetime
from typing import Any

from pydantic import JsonValue

from valerie import plugins
from valerie.db import functions as stored_functions
from valerie.db import processes
from valerie.db.engine import database_time, reading
from valerie.db.functions import FunctionRow
from valerie.errors import ValerieError
from valerie.perception.base import FunctionCard
from valerie.perception.documents.cards import CardRow, card_rows
from valerie.perception.documents.function import FunctionDocument
from valerie.perception.shipped import FUNCTIONS, function_card, function_document
from valerie.pipeline.base.context import Context
from valerie.pipeline.base.pinning import inference_name
from valerie.pipeline.functions import registry
from valerie.pipeline.functions.import_job import Trial
from valerie.runs.products.pins import FunctionOffer, Offer
from valerie.runs.products.states import Stage
from valerie.scene.assets.asset import asset_manifest, asset_names
from valerie.settings import Settings


@dataclass(frozen=True, slots=True)
class AssetEntry:
    """An asset; if it cannot be read, ``problem`` is the reason and only the name is filled in."""

    name: str
    title: str = ""
    digest: str = ""
    cameras: tuple[str, ...] = ()
    problem: str | None = None


@dataclass(frozen=True, slots=True)
class RendererEntry:
    """A render engine, and the numeric classes in which living workers offer it."""

    name: str
    numeric_classes: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class FunctionEntry:
    """A function under test.

    Attributes:
        name, digest, architecture, precision, engine, provenance, judged_by: see `FunctionCard`.
        card: title and text of each row of its card.
        numeric_classes: numeric classes in which living workers offer it.
        kind, classes, unmapped: its kind, the Cityscapes classes that it can predict, and its own classes that count as
            void; None for a class of an installed package, which has no document.
        reference, version, created_at, document: of a registered version.
        trial: trial of a version that was just registered.
        problem: the reason if its file is missing or damaged.
    """

    name: str
    digest: str
    architecture: str
    precision: str
    engine: str
    provenance: dict[str, str]
    judged_by: tuple[str, ...]
    card: list[CardRow]
    numeric_classes: tuple[str, ...]
    kind: str | None = None
    classes: tuple[str, ...] | None = None
    unmapped: tuple[str, ...] | None = None
    reference: str | None = None
    version: int | None = None
    created_at: datetime | None = None
    document: dict[str, JsonValue] | None = None
    trial: Trial | None = None
    problem: str | None = None

    @property
    def check(self) -> dict[str, JsonValue] | None:
        """The trial as JSON values."""
        return None if self.trial is None else self.trial.model_dump(mode="json", exclude_none=True)


def assets(settings: Settings) -> list[AssetEntry]:
    """Return every asset; one that cannot be read does not hide the others."""
    entries: list[AssetEntry] = []
    for name in asset_names(settings.asset_dir):
        try:
            manifest, digest = asset_manifest(name, asset_dir=settings.asset_dir)
        except ValerieError as error:
            entries.append(AssetEntry(name, problem=str(error)))
        else:
            entries.append(AssetEntry(name, manifest.title, digest, tuple(manifest.cameras)))
    return entries


def asset(settings: Settings, name: str) -> dict[str, JsonValue]:
    """Return the manifest of an asset without its outlines: parameters, cameras, persons, movables.

    Raises:
        UnknownName: no such asset.
    """
    manifest, digest = asset_manifest(name, asset_dir=settings.asset_dir)
    document = manifest.model_dump(mode="json", exclude={"obstacles", "ground"})
    return {"digest": digest, **document}


def renderers(context: Context) -> list[RendererEntry]:
    """Return the render engines."""
    offers = _offers(context, Stage.RENDER)
    return [RendererEntry(name, _numeric_classes(offers, name)) for name in plugins.renderer_names()]


def functions(context: Context) -> list[FunctionEntry]:
    """Return the installed functions, then every version of the registered ones, by name and newest first."""
    offers = _offers(context, Stage.INFER)
    entries = [_installed(name, offers) for name in plugins.function_names()]
    with reading(context.engine) as connection:
        return entries + [_registered(version, offers) for version in stored_functions.every(connection)]


def function(context: Context, reference: str) -> FunctionEntry:
    """Return one function: an installed one by its name, or a version of a registered one with its document.

    Raises:
        UnknownName, NotFound, InvalidInput: see `valerie.pipeline.functions.registry.find`.
    """
    if reference in plugins.function_names():
        return _installed(reference, _offers(context, Stage.INFER))
    with reading(context.engine) as connection:
        version = registry.find(connection, reference)
    return registered_function(context, version)


def registered_function(context: Context, version: FunctionRow, trial: Trial | None = None) -> FunctionEntry:
    """Return a registered version with its document.

    Args:
        context: context of the deployment.
        version: the registered version.
        trial: its trial, right after the registration.
    """
    document = version.document.model_dump(mode="json")
    return replace(_registered(version, _offers(context, Stage.INFER)), document=document, trial=trial)


def _installed(name: str, offers: list[Offer]) -> FunctionEntry:
    offered = next((o.card for o in offers if isinstance(o, FunctionOffer) and o.name == name), None)
    card, document, problem = offered or FunctionCard(name, "", "", "", "", {}), None, None
    if name in FUNCTIONS:
        try:
            own, document = function_card(name), function_document(name)
            card = offered or own  # workers may run on other machines, and their engine counts
        except ValerieError as error:
            problem = str(error)
    return _entry(card, document, numeric_classes=_numeric_classes(offers, name), problem=problem)


def _registered(version: FunctionRow, offers: list[Offer]) -> FunctionEntry:
    document = version.document
    return _entry(
        document.card(),
        document,
        numeric_classes=_numeric_classes(offers, inference_name(document)),
        reference=version.reference,
        version=version.version,
        created_at=version.created_at,
    )


def _entry(card: FunctionCard, document: FunctionDocument | None, **more: Any) -> FunctionEntry:
    return FunctionEntry(
        **asdict(card),
        card=card_rows(card, document),
        kind=None if document is None else document.kind,
        classes=None if document is None else document.output.reached,
        unmapped=None if document is None else document.output.unmapped,
        **more,
    )


def _offers(context: Context, stage: Stage) -> list[Offer]:
    with reading(context.engine) as connection:
        return [offer for offer in processes.offers(connection, now=database_time(connection)) if offer.stage is stage]


def _numeric_classes(offers: list[Offer], name: str) -> tuple[str, ...]:
    return tuple(sorted({offer.numeric_class for offer in offers if offer.name == name}))
