"""Makes annotations of frames: from the scene, the camera and the ground truth that is stored already."""

from __future__ import annotations

from typing import Any

from valerie.pipeline.makers.inputs import ProductReader
from valerie.rendering.annotations.kinds import AnnotationKind
from valerie.rendering.base import View
from valerie.scene.model import Scene
from valerie.storage.annotations import Annotation, encode_annotation


def annotate(
    kind: AnnotationKind, scene: Scene, view: View, *, truth: str, reader: ProductReader, truth_pass: Any
) -> bytes:
    """The stored form of one annotation.

    Args:
        kind: which.
        scene, view: of the frame.
        truth: digest of the frame's truth.
        reader: reads it.
        truth_pass: of this process (`valerie.rendering.ground_truth.TruthPass`).

    Raises:
        MissingInput: the truth's object is gone.
    """
    annotation: Annotation
    if kind is AnnotationKind.NORMALS:
        annotation = truth_pass.normals(scene, view)
    else:
        from valerie.rendering.annotations.boxes import measure_boxes

        annotation = measure_boxes(scene, view, reader.truth(truth))
    return encode_annotation(kind, annotation)
