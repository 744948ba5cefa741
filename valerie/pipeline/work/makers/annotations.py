"""Annotations of frames, computed from the scene, the camera and the stored ground truth."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from valerie.db.claiming import Job
from valerie.db.measured import MeasuredPerson
from valerie.measures import Source, names_from
from valerie.pipeline.reading.product_reader import ProductReader
from valerie.rendering.annotations.boxes import measure_boxes
from valerie.rendering.annotations.joints import measure_joints
from valerie.rendering.annotations.kinds import AnnotationKind
from valerie.rendering.base import GroundTruth, View
from valerie.rendering.person_light import LightPass, measure_light
from valerie.rendering.truth import TruthMaker
from valerie.runs.resolving.motion import VELOCITY_SPAN_S
from valerie.scene.graph.model import Scene
from valerie.storage.annotation_codecs import Annotation, encode_annotation


@dataclass(frozen=True, slots=True, eq=False)
class SeenScene:
    """A frame's scene through its camera, and its continuation.

    Attributes:
        scene, view: of the frame.
        later: returns the scene a number of seconds later.
        step: seconds until the next frame; 0 without a sequence.
    """

    scene: Scene
    view: View
    later: Callable[[float], Scene]
    step: float


def annotate(kind: AnnotationKind, seen: SeenScene, truth: Callable[[], GroundTruth], truth_pass: TruthMaker) -> bytes:
    """Make one annotation and return its stored form.

    Args:
        kind: kind of annotation.
        seen: the frame.
        truth: reads the frame's truth.
        truth_pass: truth pass of this process.

    Raises:
        MissingInput: the truth's object is gone.
    """
    annotation: Annotation
    scene, view = seen.scene, seen.view
    if kind is AnnotationKind.NORMALS:
        annotation = truth_pass.normals(scene, view)
    elif kind is AnnotationKind.FLOW:
        annotation = truth_pass.flow(scene, seen.later(seen.step), view, truth())
    elif kind is AnnotationKind.VELOCITY:
        annotation = truth_pass.velocity(scene, seen.later(VELOCITY_SPAN_S), view, truth(), VELOCITY_SPAN_S)
    else:
        measure = measure_joints if kind is AnnotationKind.JOINTS else measure_boxes
        annotation = measure(scene, view, truth())
    return encode_annotation(kind, annotation)


def lit_persons(
    job: Job, scene: Scene, view: View, *, reader: ProductReader, light: LightPass
) -> tuple[MeasuredPerson, ...]:
    """Measure the light on the visible persons of a frame.

    Args:
        job: job of kind ``light``.
        scene, view: of the frame.
        reader: reads its image and truth.
        light: light pass of this process.

    Raises:
        MissingInput: an object is gone.
    """
    image, truth = reader.frame(job.frame.products), reader.truth(job.frame.products.truth)
    return tuple(
        MeasuredPerson(person.instance_id, {name: getattr(person, name) for name in names_from(Source.LIGHT)})
        for person in measure_light(truth, image, scene, view, light)
    )
