"""Reading of finished products: whole frames, ground truth, annotations, predictions."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Final, TypeVar

import numpy as np
from cachetools import LRUCache
from numpy.typing import NDArray

from valerie.errors import CorruptArtifact, MissingInput, NotFound
from valerie.rendering.annotations.boxes import Boxes
from valerie.rendering.annotations.flow import FlowMap
from valerie.rendering.annotations.joints import Joints
from valerie.rendering.annotations.kinds import AnnotationKind
from valerie.rendering.annotations.normals import Normals
from valerie.rendering.annotations.scan import Scan
from valerie.rendering.base import WHOLE, GroundTruth, LinearImage, Window
from valerie.runs.products.frame_keys import FrameProducts
from valerie.sensing.metering import metered_ev
from valerie.storage import codecs
from valerie.storage.annotation_codecs import (
    Annotation,
    decode_boxes,
    decode_flow,
    decode_joints,
    decode_normals,
    decode_scan,
)
from valerie.storage.keys import product_key
from valerie.storage.store import ArtifactStore

#: Number of cached backgrounds, and of cached truths of statics.
_KEPT: Final = 3
Decoded = TypeVar("Decoded")


class ProductReader:
    """Reader of whole frames: the only place that joins background and layer, statics and truth layer.

    Each method raises `MissingInput` when an object is gone or damaged.
    """

    def __init__(self, store: ArtifactStore) -> None:
        self._store = store
        self._backgrounds: LRUCache[str, LinearImage] = LRUCache(_KEPT)
        self._statics: LRUCache[str, GroundTruth] = LRUCache(_KEPT)
        self._metered: LRUCache[str, float] = LRUCache(_KEPT)

    def frame(self, products: FrameProducts, window: Window = WHOLE) -> LinearImage:
        """Read the linear image of a frame, or a part of it."""
        layer = self._read("layer", products.layer, codecs.decode_layer)
        return layer.over(self.background(products.background), window)

    def background(self, digest: str) -> LinearImage:
        """Read the linear image without movables."""
        return self._kept(self._backgrounds, "background", digest, codecs.decode_image)

    def metered_ev(self, background: str) -> float:
        """Return the exposure that automatic exposure meters on a background."""
        if background not in self._metered:
            self._metered[background] = metered_ev(self.background(background).pixels)
        return self._metered[background]

    def truth(self, digest: str) -> GroundTruth:
        """Read the ground truth of a frame."""
        stored = self._read("truth", digest, codecs.decode_stored_truth)
        return stored if isinstance(stored, GroundTruth) else stored.layer.over(self._below(stored, digest))

    def class_map(self, digest: str) -> NDArray[np.uint8]:
        """Read the classes of a frame alone: (H, W) uint8."""
        stored = self._read("truth", digest, codecs.decode_stored_truth)
        if isinstance(stored, GroundTruth):
            return stored.class_map
        return stored.layer.classes_over(self._below(stored, digest).class_map)

    def _below(self, stored: codecs.StoredTruthLayer, digest: str) -> GroundTruth:
        """Return the truth of the statics below a layer."""
        try:
            statics = self._kept(self._statics, "statics", stored.statics, codecs.decode_truth)
        except MissingInput as error:
            # Making the truth again stores its statics again.
            raise MissingInput("truth", digest) from error
        if statics.class_map.shape != stored.layer.size:
            raise MissingInput("truth", digest)
        return statics

    def annotation(self, kind: AnnotationKind, digest: str) -> Annotation:
        """Read an annotation of any kind that is stored."""
        readers: dict[AnnotationKind, Callable[[str], Annotation]] = {
            AnnotationKind.NORMALS: self.normals,
            AnnotationKind.BOXES: self.boxes,
            AnnotationKind.JOINTS: self.joints,
            AnnotationKind.FLOW: self.flow,
            AnnotationKind.VELOCITY: self.velocity,
            AnnotationKind.SCAN: self.scan,
        }
        return readers[kind](digest)

    def normals(self, digest: str) -> Normals:
        """Read the normals of a frame."""
        return self._read("normals", digest, decode_normals)

    def boxes(self, digest: str) -> Boxes:
        """Read the boxes of a frame's instances."""
        return self._read("boxes", digest, decode_boxes)

    def joints(self, digest: str) -> Joints:
        """Read the joints of a frame's persons."""
        return self._read("joints", digest, decode_joints)

    def flow(self, digest: str) -> FlowMap:
        """Read the optical flow of a frame."""
        return self._read("flow", digest, decode_flow)

    def velocity(self, digest: str) -> FlowMap:
        """Read the velocities in a frame."""
        return self._read("velocity", digest, partial(decode_flow, kind=AnnotationKind.VELOCITY))

    def scan(self, digest: str) -> Scan:
        """Read the scan of a frame."""
        return self._read("scan", digest, decode_scan)

    def prediction(self, digest: str) -> NDArray[np.uint8]:
        """Read a prediction: (H, W) uint8 train ids."""
        return self._read("prediction", digest, codecs.decode_prediction)

    def _kept(
        self, cache: LRUCache[str, Decoded], kind: str, digest: str, decode: Callable[[bytes], Decoded]
    ) -> Decoded:
        if digest not in cache:
            cache[digest] = self._read(kind, digest, decode)
        return cache[digest]

    def _read(self, kind: str, digest: str, decode: Callable[[bytes], Decoded]) -> Decoded:
        try:
            return decode(self._store.get(product_key(kind, digest)))
        except (NotFound, CorruptArtifact) as error:
            raise MissingInput(kind, digest) from error
