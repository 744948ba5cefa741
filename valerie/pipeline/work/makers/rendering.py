"""Backgrounds, layers, ground truth and annotations, made with the engines of this process."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, NamedTuple

from valerie import plugins
from valerie.db.claiming import Job
from valerie.db.measured import MeasuredPerson, SeenPerson
from valerie.db.publishing import Finished, SharedStatics
from valerie.errors import RenderingError, TransientError
from valerie.parameters.assignment import canonical_json
from valerie.parameters.definitions import Value
from valerie.pipeline.base.context import Context
from valerie.pipeline.base.resolved_runs import started_run
from valerie.pipeline.reading.asset_cache import AssetCache
from valerie.pipeline.reading.person_views import NO_PERSON, seen_person
from valerie.pipeline.reading.product_reader import ProductReader
from valerie.pipeline.work.makers.annotations import SeenScene, annotate, lit_persons
from valerie.rendering.annotations.kinds import AnnotationKind
from valerie.rendering.base import GroundTruth, Renderer, View
from valerie.rendering.person_light import LightPass
from valerie.rendering.scanning import Readout, scan
from valerie.rendering.truth import TruthMaker
from valerie.runs.products.states import ProductKind
from valerie.runs.resolving.sensors import focal_length_mm, rolling_shutter
from valerie.runs.resolving.spec import ResolvedRun
from valerie.scene.assets.asset import SceneAsset
from valerie.scene.graph.model import Scene
from valerie.scene.variation.variant import apply
from valerie.sensing.sensor import read_lines
from valerie.storage import codecs
from valerie.storage.annotation_codecs import encode_annotation
from valerie.storage.keys import product_key
from valerie.storage.store import ArtifactStore

#: Number of truths of statics whose digests are cached, as many as in the truth pass.
_KEPT_STATICS: Final = 4


#: Kinds of products that the spec's engine renders.
_BY_ENGINE: Final = frozenset({ProductKind.BACKGROUND, ProductKind.LAYER, ProductKind.SCAN})


@dataclass(frozen=True, slots=True, eq=False)
class _Subject:
    """The frame of a job: its run, its scene and its camera."""

    job: Job
    resolved: ResolvedRun
    asset: SceneAsset
    scene: Scene
    view: View

    @classmethod
    def of(cls, job: Job, resolved: ResolvedRun, asset: SceneAsset) -> _Subject:
        key, size = job.frame.key, resolved.spec.resolution
        scene = apply(resolved.at(job.frame.assignment, key.time), asset)
        return cls(job, resolved, asset, scene, View(resolved.cameras[key.camera], size.width, size.height))

    def near(self, seconds: float) -> Scene:
        """Return the scene a number of seconds after the frame."""
        frame = self.job.frame
        return apply(self.resolved.near(frame.assignment, frame.key.time, seconds), self.asset)


class _Made(NamedTuple):
    """The object of a product, empty if it has none, and the rows that describe it."""

    data: bytes
    views: tuple[SeenPerson, ...] = ()
    lights: tuple[MeasuredPerson, ...] = ()
    part: SharedStatics | None = None


class RenderMaker:
    """Maker of rendered products. An engine is opened at its first use and stays open: one context per process and engine."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._assets = AssetCache(context.settings)
        self._reader = ProductReader(context.store)
        self._engines: dict[tuple[str, bytes], Renderer] = {}
        self._truth: TruthMaker | None = None
        self._statics = _Statics(context.store)

    def make(self, job: Job) -> Finished:
        """See `valerie.pipeline.work.stages.Maker`."""
        started = time.process_time()
        run = started_run(self._context, job.frame.key.run_id)
        pins = run.pins.at(job.frame.assignment)
        subject = _Subject.of(job, run.resolved, self._assets.of(run))
        engine = self._engine(run.resolved, pins.engine.numeric_class) if job.kind in _BY_ENGINE else None
        elsewhere = cpu_seconds_elsewhere(engine)
        made = self._made(subject, engine, pins.truth.numeric_class)
        if made.data:
            self._context.store.put(product_key(job.kind, job.digest), made.data)
        return Finished(
            digest=job.digest,
            bytes=len(made.data),
            pixels=subject.view.width * subject.view.height,
            cpu_seconds=time.process_time() - started + cpu_seconds_elsewhere(engine) - elsewhere,
            person_views=made.views,
            part=made.part,
            person_lights=made.lights,
        )

    def _made(self, subject: _Subject, engine: Renderer | None, truth_class: str) -> _Made:
        """Make a product: by the spec's engine, if it is given, or by the passes of the truth's numeric class."""
        job, scene, view = subject.job, subject.scene, subject.view
        if engine is not None:
            if job.kind is ProductKind.BACKGROUND:
                return _Made(codecs.encode_image(engine.background(scene, view)))
            if job.kind is ProductKind.LAYER:
                return _Made(codecs.encode_layer(engine.layer(scene, view)))
            return _Made(self._scan(subject, engine, self._truth_pass(truth_class)))
        if job.kind is ProductKind.LIGHT:
            light = self._light_pass(truth_class)
            return _Made(b"", lights=lit_persons(job, scene, view, reader=self._reader, light=light))
        truth_pass = self._truth_pass(truth_class)
        if job.kind is ProductKind.TRUTH:
            return self._truth_of(subject, truth_pass)
        seen = SeenScene(scene, view, later=subject.near, step=subject.resolved.times.step or 0.0)
        kind, truth = AnnotationKind(job.kind), job.frame.products.truth
        return _Made(annotate(kind, seen, lambda: self._reader.truth(truth), truth_pass))

    def _truth_of(self, subject: _Subject, truth_pass: TruthMaker) -> _Made:
        """Make a truth: it is stored as a layer over the truth of its statics."""
        from valerie.rendering.visibility import measure

        statics, layer = truth_pass.parts(subject.scene, subject.view)
        persons = measure(layer.over(statics), subject.scene, subject.view)
        part = self._statics.stored(statics, again=subject.job.attempts > 1)
        views = tuple(map(seen_person, persons)) or (NO_PERSON,)
        return _Made(codecs.encode_truth_layer(layer, part.digest), views, part=part)

    def _scan(self, subject: _Subject, engine: Renderer, truth_pass: TruthMaker) -> bytes:
        """Return the frame line by line, as the rolling shutter of the run's sensors reads it."""
        job, resolved, view = subject.job, subject.resolved, subject.view
        assignment, products = job.frame.assignment, job.frame.products
        shutter = rolling_shutter(resolved.spec.sensors, assignment)
        if shutter is None:
            raise RenderingError(f"product {job.digest}: no sensor of the frame has a rolling shutter")
        focal_length = focal_length_mm(resolved.manifest, view.camera, resolved.at(assignment, job.frame.key.time))
        lines = read_lines(shutter.setting, view.width, view.height, focal_length)
        readout = Readout(lines, shutter.setting.shutter.line_time_us * 1e-6, shutter.blurs)
        frame = self._reader.frame(products), self._reader.truth(products.truth)
        scanned = scan(engine, truth_pass, subject.near, view, frame, readout)
        return encode_annotation(AnnotationKind.SCAN, scanned)

    def _engine(self, resolved: ResolvedRun, numeric_class: str) -> Renderer:
        engine = self._opened(resolved.spec.engine, resolved.spec.engine_settings, resolved.engine_inputs)
        _require_class(resolved.spec.engine, engine.numeric_class, numeric_class)
        return engine

    def _light_pass(self, numeric_class: str) -> LightPass:
        engine = self._opened(plugins.light_engine(numeric_class), {}, {})
        _require_class("light", engine.numeric_class, numeric_class)
        assert isinstance(engine, LightPass), "the engine of the truth pass knows what light arrives where"
        return engine

    def _opened(self, name: str, settings: Mapping[str, Value], inputs: Mapping[str, Value]) -> Renderer:
        """Return the engine with these settings, opened at its first use."""
        key = (name, canonical_json(inputs))
        if key not in self._engines:
            self._engines[key] = plugins.create_renderer(name, settings)
        return self._engines[key]

    def _truth_pass(self, numeric_class: str) -> TruthMaker:
        if self._truth is None:
            self._truth = plugins.create_truth_pass(numeric_class)
        _require_class("truth", self._truth.numeric_class, numeric_class)
        return self._truth


class _Statics:
    """Store of truths of statics, each stored once; the truths of frames are stored as layers over them."""

    def __init__(self, store: ArtifactStore) -> None:
        self._store = store
        self._known: deque[tuple[GroundTruth, str]] = deque(maxlen=_KEPT_STATICS)

    def stored(self, statics: GroundTruth, *, again: bool) -> SharedStatics:
        """Store a truth of statics; return its part of the product.

        Args:
            statics: the truth without movables.
            again: True at a second attempt, which replaces a damaged object.
        """
        digest = next((digest for known, digest in self._known if known is statics), None)
        if digest is None:
            digest = codecs.statics_digest(statics)
            self._known.append((statics, digest))
        key = product_key("statics", digest)
        if again or not self._store.exists(key):
            self._store.put(key, codecs.encode_truth(statics))
        return SharedStatics(digest, self._store.head(key).size, statics.class_map.size)


def cpu_seconds_elsewhere(engine: Renderer | None) -> float:
    """Return the CPU seconds that an engine has used in other processes so far; see `valerie.rendering.base.Renderer`."""
    return float(getattr(engine, "cpu_seconds_elsewhere", 0.0))


def _require_class(name: str, actual: str, pinned: str) -> None:
    """Refuse a driver that changed during a worker's life, so that a run does not mix numeric classes."""
    if actual != pinned:
        raise TransientError(f"{name} runs as {actual} here, but the run pinned {pinned}")
