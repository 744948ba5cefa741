"""Reading finished products back: whole frames, ground truth, predictions."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from functools import partial
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from valerie.errors import CorruptArtifact, MissingInput, NotFound
from valerie.rendering.annotations.boxes import Boxes
from valerie.rendering.annotations.flow import FlowMap
from valerie.rendering.annotations.joints import Joints
from valerie.rendering.annotations.kinds import AnnotationKind
from valerie.rendering.annotations.normals import Normals
from valerie.rendering.base import GroundTruth, LinearImage
from valerie.storage import codecs
from valerie.storage.annotations import Annotation, decode_boxes, decode_flow, decode_joints, decode_normals
from valerie.storage.keys import product_key
from valerie.storage.store import ArtifactStore

#: Backgrounds kept, and truths of statics.
_KEPT = 3
Decoded = TypeVar("Decoded")


class ProductReader:
    """Readers see whole frames: background and layer, statics and truth layer are put together here, and nowhere else.

    Each method raises `MissingInput` when an object is gone or damaged.
    """

    def __init__(self, store: ArtifactStore) -> None:
        self._store = store
        self._backgrounds: OrderedDict[str, LinearImage] = OrderedDict()
        self._statics: OrderedDict[str, GroundTruth] = OrderedDict()

    def frame(self, background: str, layer: str) -> LinearImage:
        """The linear image of a frame."""
        return self._read("layer", layer, codecs.decode_layer).over(self._background(background))

    def truth(self, digest: str) -> GroundTruth:
        """Ground truth of a frame."""
        stored = self._read("truth", digest, codecs.decode_stored_truth)
        if isinstance(stored, GroundTruth):
            return stored
        statics = self._kept_statics(stored.statics, of=digest)
        if statics.class_map.shape != stored.layer.size:
            raise MissingInput("truth", digest)
        return stored.layer.over(statics)

    def flow(self, digest: str) -> FlowMap:
        """Optical flow of a frame."""
        return self._read("flow", digest, decode_flow)

    def velocity(self, digest: str) -> FlowMap:
        """Velocities in a frame."""
        return self._read("velocity", digest, partial(decode_flow, kind=AnnotationKind.VELOCITY))

    def annotation(self, kind: AnnotationKind, digest: str) -> Annotation:
        """An annotation of any kind that is stored."""
        readers: dict[AnnotationKind, Callable[[str], Annotation]] = {
            AnnotationKind.NORMALS: self.normals,
            AnnotationKind.BOXES: self.boxes,
            AnnotationKind.JOINTS: self.joints,
            AnnotationKind.FLOW: self.flow,
            AnnotationKind.VELOCITY: self.velocity,
        }
        return readers[kind](digest)

    def normals(self, digest: str) -> Normals:
        """Normals of a frame."""
        return self._read("normals", digest, decode_normals)

    def boxes(self, digest: str) -> Boxes:
        """Boxes of a frame's instances."""
        return self._read("boxes", digest, decode_boxes)

    def joints(self, digest: str) -> Joints:
        """Joints of a frame's persons."""
        return self._read("joints", digest, decode_joints)

    def prediction(self, digest: str) -> NDArray[np.uint8]:
        """(H, W) uint8 train ids."""
        return self._read("prediction", digest, codecs.decode_prediction)

    def _background(self, digest: str) -> LinearImage:
        return _kept(self._backgrounds, digest, lambda: self._read("background", digest, codecs.decode_image))

    def _kept_statics(self, digest: str, *, of: str) -> GroundTruth:
        try:
            return _kept(self._statics, digest, lambda: self._read("statics", digest, codecs.decode_truth))
        except MissingInput as error:
            # Who makes the truth again stores its statics again.
            raise MissingInput("truth", of) from error

    def _read(self, kind: str, digest: str, decode: Callable[[bytes], Decoded]) -> Decoded:
        try:
            return decode(self._store.get(product_key(kind, digest)))
        except (NotFound, CorruptArtifact) as error:
            raise MissingInput(kind, digest) from error


def _kept(cache: OrderedDict[str, Decoded], digest: str, read: Callable[[], Decoded]) -> Decoded:
    if digest not in cache:
        cache[digest] = read()
        while len(cache) > _KEPT:
            cache.popitem(last=False)
    cache.move_to_end(digest)
    return cache[digest]
