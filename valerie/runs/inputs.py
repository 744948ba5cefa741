"""What each product of a frame truly depends on, and the digests that follow: the identity of all stored work.

Per frame (variant, camera): ::

    background   asset, everything that is not below a movable node, camera, resolution, engine with its settings
    layer        background, everything of the scene, engine
    truth        asset, poses and characters, camera, resolution, truth pass
    annotation   truth; of kind light: background, layer, truth, truth pass
    prediction   background, layer, sensor response, function; truth, where the sensor needs depth
    evaluation   prediction, truth

A sensor that distorts is in the prediction's digest, and so in that of the evaluation, which distorts the truth likewise.
"Engine", "truth pass" and "function" stand for name (or weights), hand-raised revision and numeric class, as the run
pinned them at submission. Names of runs, variants, sensors and parameters are inputs of nothing: equal work has equal
digests.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any, Final, NamedTuple

import orjson

from valerie.parameters.assignment import CanonicalJson, DigestPrefix, canonical_json
from valerie.parameters.definitions import Value
from valerie.rendering.annotations.kinds import AnnotationKind
from valerie.runs.resolution import ResolvedRun
from valerie.runs.sensors import Response, response, sensor_values
from valerie.runs.states import ProductKind
from valerie.scene.variation import split
from valerie.sensing.sensor import REVISION as SENSING_REVISION

#: Raised by hand whenever equal predictions and truths give other counts.
EVALUATION_REVISION: Final = 1
#: Raised by hand whenever an annotation of equal truth differs.
ANNOTATION_REVISIONS: Final = {AnnotationKind.NORMALS: 1, AnnotationKind.BOXES: 1, AnnotationKind.LIGHT: 1}
#: Raised by hand whenever the meaning of the digests below changes.
_SCHEME: Final = 1


class EvaluationDigests(NamedTuple):
    """One function on one picture of a frame.

    Attributes:
        sensor_index: place in ``spec.sensors``.
        function_index: place in ``spec.functions``.
        prediction, scores: digests of the prediction and of the evaluation.
        needs_depth: the prediction waits for the truth, whose depth its sensor needs.
        distorted: the sensor distorts, so the evaluation measures visibility itself.
    """

    sensor_index: int
    function_index: int
    prediction: str
    scores: str
    needs_depth: bool = False
    distorted: bool = False


class AnnotationDigest(NamedTuple):
    """One annotation of a frame.

    Attributes:
        kind: a kind of product.
        product: its digest.
        inputs: digests of the products that it is made from, three at most.
    """

    kind: ProductKind
    product: str
    inputs: tuple[str, ...]


class FrameDigests(NamedTuple):
    """All products of one frame."""

    background: str
    layer: str
    truth: str
    evaluations: tuple[EvaluationDigests, ...]
    annotations: tuple[AnnotationDigest, ...] = ()


class ProductInputs:
    """Digests of the products of a run's frames; what frames share is hashed once.

    Args:
        resolved: the run.
        asset_digest: of its asset.
        pins: what the run pinned: ``engine`` and ``truth`` with ``numeric_class`` and ``revision``, ``functions`` by
            name with ``digest``, ``revision`` and ``numeric_class``.
    """

    def __init__(self, resolved: ResolvedRun, *, asset_digest: str, pins: Mapping[str, Any]) -> None:
        spec = resolved.spec
        self._manifest = resolved.manifest
        self._cameras = resolved.cameras
        self._sensors = spec.sensors
        self._seed = spec.seed
        engine = {"name": spec.engine, **_pinned(pins["engine"])}
        if resolved.engine_inputs:
            engine["settings"] = dict(resolved.engine_inputs)
        resolution = spec.resolution.model_dump()
        self._background: list[DigestPrefix] = []
        self._truth: list[DigestPrefix] = []
        for camera in self._cameras:
            view = {"camera": camera, **resolution}
            self._background.append(_prefix(ProductKind.BACKGROUND, asset_digest, view, engine))
            self._truth.append(_prefix(ProductKind.TRUTH, asset_digest, view, _pinned(pins["truth"])))
        self._layer = _prefix(ProductKind.LAYER, engine)
        self._predictions = [
            _prefix(
                ProductKind.PREDICTION,
                _function(pins["functions"][name]),
                SENSING_REVISION,
            )
            for name in spec.functions
        ]
        self._evaluation = _prefix(ProductKind.EVALUATION, EVALUATION_REVISION)
        self._annotations = [
            # What light arrives somewhere is computed by the engine of the truth pass, whichever made the image.
            (
                kind,
                _prefix(
                    ProductKind(kind),
                    ANNOTATION_REVISIONS[kind],
                    *((_pinned(pins["truth"]),) if kind is AnnotationKind.LIGHT else ()),
                ),
            )
            for kind in spec.annotations
        ]
        # Most variants of a run share the light, and so the background.
        self._background_digest = lru_cache(maxsize=1024)(self._hash_background)
        self._responses = lru_cache(maxsize=1024)(self._respond)

    def frame(self, assignment: Mapping[str, Value], camera_index: int) -> FrameDigests:
        """The products of the frame that ``resolved.cameras[camera_index]`` takes of a variant at a moment (`ResolvedRun.at`)."""
        inputs = split(assignment, self._manifest, self._cameras[camera_index])
        background = self._background_digest(camera_index, inputs.background)
        layer = self._layer.digest(background, inputs.layer)
        truth = self._truth[camera_index].digest(inputs.geometry)
        evaluations = []
        # Only what the variant says of the sensor overrides the setting; the asset's defaults do not.
        sensor = {path: inputs.sensor[path] for path in sensor_values(assignment)}
        for sensor_index, (document, needs_depth, distorted) in enumerate(self._responses(canonical_json(sensor))):
            for function_index, prefix in enumerate(self._predictions):
                depth = (truth,) if needs_depth else ()
                prediction = prefix.digest(background, layer, document, *depth)
                scores = self._evaluation.digest(prediction, truth)
                evaluations.append(
                    EvaluationDigests(sensor_index, function_index, prediction, scores, needs_depth, distorted)
                )
        annotations = []
        for kind, prefix in self._annotations:
            made_from = (background, layer, truth) if kind is AnnotationKind.LIGHT else (truth,)
            annotations.append(AnnotationDigest(ProductKind(kind), prefix.digest(*made_from), made_from))
        return FrameDigests(background, layer, truth, tuple(evaluations), tuple(annotations))

    def _hash_background(self, camera_index: int, inputs: CanonicalJson) -> str:
        # As bytes, not as JSON: the digests of all backgrounds so far.
        return self._background[camera_index].digest(bytes(inputs))

    def _respond(self, sensor: bytes) -> list[Response]:
        """What a prediction depends on behind each sensor of the run; ``sensor`` is the variant's, as canonical JSON."""
        values = orjson.loads(sensor)
        return [response(setting, values, self._seed) for setting in self._sensors]


def _prefix(kind: ProductKind, *parts: object) -> DigestPrefix:
    return DigestPrefix(_SCHEME, kind.value, *parts)


def _pinned(pin: Mapping[str, Any]) -> dict[str, Any]:
    return {key: pin[key] for key in ("revision", "numeric_class")}


def _function(pin: Mapping[str, Any]) -> dict[str, Any]:
    # A function that states no revision is in its first.
    return {"digest": pin["digest"], "numeric_class": pin["numeric_class"], "revision": pin.get("revision", 1)}
