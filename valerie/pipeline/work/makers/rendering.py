"""Backgrounds, layers, ground truth and annotations, made with the engines of this process."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Mapping
from typing import Final

from valerie import plugins
from valerie.db.claiming import Job
from valerie.db.measured import MeasuredPerson, SeenPerson
from valerie.db.publishing import Finished, SharedStatics
from valerie.errors import RenderingError, TransientError
from valerie.parameters.assignment import canonical_json
from valerie.parameters.definitions import Value
from valerie.pipeline.base.context import Context
from valerie.pipeline.reading.person_views import NO_PERSON, seen_person
from valerie.pipeline.reading.product_reader import ProductReader
from valerie.pipeline.reading.run_cache import RunCache
from valerie.pipeline.work.makers.annotations import SeenScene, annotate, lit_persons
from valerie.rendering.annotations.kinds import AnnotationKind
from valerie.rendering.base import GroundTruth, Renderer, View
from valerie.rendering.person_light import LightPass
from valerie.rendering.scanning import Readout, scan
from valerie.rendering.truth import TruthMaker
from valerie.runs.products.states import ProductKind
from valerie.runs.resolving.sensors import focal_length_mm, rolling_shutter
from valerie.runs.resolving.spec import ResolvedRun
from valerie.scene.variation.variant import apply
from valerie.sensing.sensor import read_lines
from valerie.storage import codecs
from valerie.storage.annotation_codecs import encode_annotation
from valerie.storage.keys import product_key
from valerie.storage.store import ArtifactStore

#: Number of truths of statics whose digests are cached, as many as in the truth pass.
_KEPT_STATICS: Final = 4

_ANNOTATIONS: Final = frozenset(ProductKind(kind) for kind in AnnotationKind)


class RenderMaker:
    """Maker of rendered products. An engine is opened at its first use and stays open: one context per process and engine."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._runs = RunCache(context)
        self._reader = ProductReader(context.store)
        self._engines: dict[tuple[str, bytes], Renderer] = {}
        self._truth: TruthMaker | None = None
        self._statics = _Statics(context.store)

    def make(self, job: Job) -> Finished:
        """See `valerie.pipeline.work.stages.Maker`."""
        started, elsewhere, engine = time.process_time(), 0.0, None
        key, assignment = job.frame.key, job.frame.assignment
        run = self._runs.run(key.run_id)
        resolved, pins = run.resolved, run.pins.at(assignment)
        asset = self._runs.asset(run)
        scene = apply(resolved.at(assignment, key.time), asset)
        resolution = resolved.spec.resolution
        view = View(resolved.cameras[key.camera], resolution.width, resolution.height)
        views: tuple[SeenPerson, ...] = ()
        part: SharedStatics | None = None
        lights: tuple[MeasuredPerson, ...] = ()
        data = b""
        if job.kind is ProductKind.TRUTH:
            from valerie.rendering.visibility import measure

            truth_pass = self._truth_pass(pins.truth.numeric_class)
            statics, layer = truth_pass.parts(scene, view)
            truth = layer.over(statics)
            views = tuple(map(seen_person, measure(truth, scene, view))) or (NO_PERSON,)
            part = self._statics.stored(statics, again=job.attempts > 1)
            data = codecs.encode_truth_layer(layer, part.digest)
        elif job.kind is ProductKind.LIGHT:
            light = self._light_pass(pins.truth.numeric_class)
            lights = lit_persons(job, scene, view, reader=self._reader, light=light)
        elif job.kind is ProductKind.SCAN:
            engine = self._engine(resolved, pins.engine.numeric_class)
            elsewhere = _cpu_seconds_elsewhere(engine)
            shutter = rolling_shutter(resolved.spec.sensors, assignment)
            if shutter is None:
                raise RenderingError(f"product {job.digest}: no sensor of the frame has a rolling shutter")
            camera = focal_length_mm(resolved.manifest, view.camera, resolved.at(assignment, key.time))
            products = job.frame.products
            frame_scan = scan(
                engine,
                self._truth_pass(pins.truth.numeric_class),
                lambda seconds: apply(resolved.near(assignment, key.time, seconds), asset),
                view,
                (self._reader.frame(products), self._reader.truth(products.truth)),
                Readout(
                    read_lines(shutter.setting, view.width, view.height, camera),
                    shutter.setting.shutter.line_time_us * 1e-6,
                    shutter.blurs,
                ),
            )
            data = encode_annotation(AnnotationKind.SCAN, frame_scan)
        elif job.kind in _ANNOTATIONS:
            truth_pass = self._truth_pass(pins.truth.numeric_class)
            kind = AnnotationKind(job.kind)
            subject = SeenScene(
                scene,
                view,
                later=lambda seconds: apply(resolved.near(assignment, key.time, seconds), asset),
                step=resolved.times.step or 0.0,
            )
            data = annotate(kind, subject, lambda: self._reader.truth(job.frame.products.truth), truth_pass)
        else:
            engine = self._engine(resolved, pins.engine.numeric_class)
            elsewhere = _cpu_seconds_elsewhere(engine)
            if job.kind is ProductKind.BACKGROUND:
                data = codecs.encode_image(engine.background(scene, view))
            else:
                data = codecs.encode_layer(engine.layer(scene, view))
        if data:
            self._context.store.put(product_key(job.kind, job.digest), data)
        return Finished(
            digest=job.digest,
            bytes=len(data),
            pixels=view.width * view.height,
            cpu_seconds=time.process_time() - started + _cpu_seconds_elsewhere(engine) - elsewhere,
            person_views=views,
            part=part,
            person_lights=lights,
        )

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


def _cpu_seconds_elsewhere(engine: Renderer | None) -> float:
    """Return the CPU seconds that an engine has used in other processes so far; see `valerie.rendering.base.Renderer`."""
    return float(getattr(engine, "cpu_seconds_elsewhere", 0.0))


def _require_class(name: str, actual: str, pinned: str) -> None:
    """Refuse a driver that changed during a worker's life, so that a run does not mix numeric classes."""
    if actual != pinned:
        raise TransientError(f"{name} runs as {actual} here, but the run pinned {pinned}")
