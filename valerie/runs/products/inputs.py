"""The inputs of each product of a frame, and the digests over them, which identify all stored work.

Inputs by product: ::

    background   asset, everything outside movable nodes, camera, resolution, engine with its settings
    layer        background, everything of the scene, engine
    truth        asset, poses and characters, camera, resolution, truth pass
    annotation   truth; light: also background, layer and truth pass; flow and velocity: also the truth of a later moment;
                 scan: also background, layer and truth pass, the trajectories, line time and distortion of the sensor
    prediction   background, layer, sensor response, function; truth, velocity and scan if the sensor needs them
    empty        background, sensor response, function: the prediction of the scene without movables
    evaluation   prediction, truth; the classes that the function is judged by if they are fewer than 19, the labels if not
                 exact; the empty prediction if there is one

A sensor's distortion enters the digest of the prediction, and through it that of the evaluation, which distorts the truth in
the same way. "Engine", "truth pass" and "function" stand for name (or weights), revision and numeric class, as the run
pinned them at submission. The names of runs, variants, sensors and parameters are never inputs, so equal work has equal
digests.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Final, NamedTuple

import orjson

from valerie.parameters.assignment import CanonicalJson, DigestPrefix, canonical_json
from valerie.parameters.definitions import Value
from valerie.rendering.annotations.kinds import AnnotationKind
from valerie.rendering.label_policy import LabelPolicy
from valerie.runs.products.frame_keys import FrameProducts
from valerie.runs.products.pins import FunctionPin, Offer, Pins
from valerie.runs.products.states import UPLOADED_ROUTE, ProductKind
from valerie.runs.resolving.motion import VELOCITY_SPAN_S
from valerie.runs.resolving.resolution import Course, ResolvedRun
from valerie.runs.resolving.sensors import Response, response_of, rolling_shutter, sensor_values
from valerie.scene.variation.variant import split
from valerie.sensing.sensor import REVISION as SENSING_REVISION

#: Raise it whenever the counts for an equal prediction and truth change.
EVALUATION_REVISION: Final = 1
#: Raise an entry whenever the annotation of an equal truth changes.
ANNOTATION_REVISIONS: Final = {
    AnnotationKind.NORMALS: 1,
    AnnotationKind.BOXES: 1,
    AnnotationKind.JOINTS: 2,
    AnnotationKind.LIGHT: 6,
    AnnotationKind.FLOW: 1,
    AnnotationKind.VELOCITY: 1,
    AnnotationKind.SCAN: 1,
}
#: Raise it whenever the meaning of the digests below changes.
_SCHEME: Final = 1
#: Annotations that also need the image.
_OF_IMAGE: Final = (AnnotationKind.LIGHT, AnnotationKind.SCAN)


class EvaluationDigests(NamedTuple):
    """One function on one picture of a frame.

    Attributes:
        sensor_index: index in ``spec.sensors``.
        function_index: index in ``spec.functions``.
        prediction, scores: digests of the prediction and of the evaluation.
        third: digest of the product that the prediction waits for besides background and layer: the truth, if its
            sensor needs depth, or the velocity or the scan, which itself waits for the truth.
        distorted: True if the sensor distorts, so that the evaluation measures visibility itself.
        empty: digest of the prediction of the background without movables; None if it is not made.
    """

    sensor_index: int
    function_index: int
    prediction: str
    scores: str
    third: str | None = None
    distorted: bool = False
    empty: str | None = None


class AnnotationDigest(NamedTuple):
    """One annotation of a frame.

    Attributes:
        kind: its kind as a product.
        product: its digest.
        inputs: digests of the products that it is computed from, at most three.
    """

    kind: ProductKind
    product: str
    inputs: tuple[str, ...]


class FrameDigests(NamedTuple):
    """The digests of all products of one frame.

    Attributes:
        products: background, layer, truth, velocity and scan.
        evaluations: one for each sensor and function.
        annotations: one for each kind in the run.
    """

    products: FrameProducts
    evaluations: tuple[EvaluationDigests, ...]
    annotations: tuple[AnnotationDigest, ...] = ()


class ProductInputs:
    """Digests of the products of a run's frames; parts that frames share are hashed once.

    Args:
        resolved: the run.
        asset_digest: digest of its asset.
        pins: pins of the run.
        tenant: of the run. It is part of every digest, so that products are shared within a tenant only; empty: nobody's.
    """

    def __init__(self, resolved: ResolvedRun, *, asset_digest: str, pins: Pins, tenant: str = "") -> None:
        begun = DigestPrefix(_SCHEME, *([{"tenant": tenant}] if tenant else []))

        def _prefix(kind: ProductKind, *parts: object) -> DigestPrefix:
            return begun.extended(kind.value, *parts)

        spec = resolved.spec
        self._manifest = resolved.manifest
        self._cameras = resolved.cameras
        self._sensors = spec.sensors
        self._seed = spec.seed
        self._moves = resolved.times.motion is not None
        settings = {"settings": dict(resolved.engine_inputs)} if resolved.engine_inputs else {}
        engine = {"name": spec.engine, **_pinned(pins.engine), **settings}
        resolution = spec.resolution.model_dump()
        self._background: list[DigestPrefix] = []
        self._truth: list[DigestPrefix] = []
        for camera in self._cameras:
            view = {"camera": camera, **resolution}
            self._background.append(_prefix(ProductKind.BACKGROUND, asset_digest, view, engine))
            self._truth.append(_prefix(ProductKind.TRUTH, asset_digest, view, _pinned(pins.truth)))
        self._layer = _prefix(ProductKind.LAYER, engine)
        self._predictions = [
            _prefix(
                ProductKind.PREDICTION,
                _function(pins.functions[name]),
                SENSING_REVISION,
            )
            for name in spec.functions
        ]
        labels = () if spec.labels is LabelPolicy.EXACT else (spec.labels.value,)
        self._evaluations = [
            _prefix(ProductKind.EVALUATION, EVALUATION_REVISION, *_judged(pins.functions[name]), *labels)
            for name in spec.functions
        ]
        infers_backgrounds = resolved.infers_backgrounds
        self._sees_empty = [
            infers_backgrounds and pins.functions[name].route != UPLOADED_ROUTE for name in spec.functions
        ]
        self._annotations = [
            # The truth pass computes the light annotation, whichever engine made the image.
            (
                kind,
                _prefix(
                    ProductKind(kind),
                    ANNOTATION_REVISIONS[kind],
                    *((_pinned(pins.truth),) if kind in _OF_IMAGE else ()),
                    *(_trajectories(resolved) if kind is AnnotationKind.SCAN else ()),
                ),
            )
            for kind in resolved.annotations
        ]
        self._later = {AnnotationKind.FLOW: resolved.times.step or 0.0, AnnotationKind.VELOCITY: VELOCITY_SPAN_S}
        # Most variants of a run share the light, and so the background.
        self._background_digest = lru_cache(maxsize=1024)(self._hash_background)
        self._responses = lru_cache(maxsize=1024)(self._respond)
        self._empty_digest = lru_cache(maxsize=4096)(self._hash_empty)

    def frame(
        self, assignment: Mapping[str, Value], camera_index: int, *, course: Course | None = None
    ) -> FrameDigests:
        """Return the digests of the products of one frame.

        Args:
            assignment: assignment at the frame's moment (`ResolvedRun.at`).
            camera_index: index in ``resolved.cameras``.
            course: motion of the variant (`ResolvedRun.around`), which flow, velocity and scan depend on.
        """
        inputs = split(assignment, self._manifest, self._cameras[camera_index])
        background = self._background_digest(camera_index, inputs.background)
        layer = self._layer.digest(background, inputs.layer)
        truth = self._truth[camera_index].digest(inputs.geometry)
        annotations = []
        for kind, prefix in self._annotations:
            sources = (background, layer, truth) if kind in _OF_IMAGE else (truth,)
            further: list[object] = [*self._later_truth(kind, camera_index, course)]
            if kind is AnnotationKind.SCAN:
                shutter = rolling_shutter(self._sensors, assignment)
                if shutter is None:
                    continue
                assert course is not None, "a scan depends on other moments too"
                further = [shutter.document, course.values.decode()]
            product = prefix.digest(*sources, *further)
            annotations.append(AnnotationDigest(ProductKind(kind), product, sources))
        by_kind = {annotation.kind: annotation.product for annotation in annotations}
        velocity, scan = by_kind.get(ProductKind.VELOCITY), by_kind.get(ProductKind.SCAN)
        evaluations = []
        # Only the variant's own values override the sensor setting; the asset's defaults do not.
        sensor = {path: inputs.sensor[path] for path in sensor_values(assignment)}
        for sensor_index, response in enumerate(self._responses(canonical_json(sensor))):
            waits = [truth] if response.needs_depth else []
            if response.rolls and scan is not None:
                waits.append(scan)
            elif response.needs_velocity and velocity is not None:
                waits.append(velocity)
            for function_index, prefix in enumerate(self._predictions):
                prediction = prefix.digest(background, layer, response.document, *waits)
                empty = self._empty_digest(function_index, background, response)
                scores = self._evaluations[function_index].digest(*filter(None, (prediction, truth, empty)))
                evaluations.append(
                    EvaluationDigests(
                        sensor_index,
                        function_index,
                        prediction,
                        scores,
                        waits[-1] if waits else None,
                        response.distorts,
                        empty,
                    )
                )
        products = FrameProducts(background, layer, truth, velocity, scan)
        return FrameDigests(products, tuple(evaluations), tuple(annotations))

    def _later_truth(self, kind: AnnotationKind, camera_index: int, course: Course | None) -> tuple[str, ...]:
        """Return the digest of the truth at the later moment that an annotation depends on; that truth is never stored."""
        if kind not in self._later:
            return ()
        assert course is not None, "flow and velocity depend on a later moment too"
        inputs = split(course.near(self._later[kind]), self._manifest, self._cameras[camera_index])
        return (self._truth[camera_index].digest(inputs.geometry),)

    def _hash_background(self, camera_index: int, inputs: CanonicalJson) -> str:
        # Hashed as bytes, not as JSON: existing digests of backgrounds depend on it.
        return self._background[camera_index].digest(bytes(inputs))

    def _hash_empty(self, function_index: int, background: str, response: Response) -> str | None:
        # Depths, velocities and scans of the scene without movables are not stored.
        if not self._sees_empty[function_index] or response.needs_depth or response.needs_velocity or response.rolls:
            return None
        return self._predictions[function_index].digest(background, response.document)

    def _respond(self, sensor: bytes) -> list[Response]:
        """Return the response of each sensor of the run for a variant's sensor values in canonical JSON."""
        values = orjson.loads(sensor)
        return [response_of(setting, values, self._seed, moves=self._moves) for setting in self._sensors]


def _pinned(offer: Offer) -> dict[str, str | int]:
    return {"revision": offer.revision, "numeric_class": offer.numeric_class}


def _trajectories(resolved: ResolvedRun) -> tuple[object, ...]:
    motion = resolved.times.motion
    return () if motion is None else tuple(trajectory.model_dump() for trajectory in motion.trajectories)


def _function(pin: FunctionPin) -> dict[str, str | int]:
    return {"digest": pin.digest, **_pinned(pin)}


def _judged(pin: FunctionPin) -> tuple[list[str], ...]:
    """Return the classes that a function is judged by; empty if it is judged by all."""
    return (list(pin.card.judged_by),) if pin.card.judged_by else ()
