"""Engines of negligible cost, for measurements of the control plane and for its tests without GL and torch.

Only workers with ``VALERIE_RENDER_ENGINES=blank`` or ``VALERIE_INFER_FUNCTIONS=blank`` offer them. A spec may name them only
if ``VALERIE_TESTING_ENGINES`` is on, so that nobody mistakes their output for a result.

Tests of several numeric classes set ``VALERIE_TEST_BLANK_CLASS`` in a worker's environment, and the difference of its results as
``VALERIE_TEST_BLANK_SHIFT``: radiance added to backgrounds, and to the threshold of the function.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Sequence
from typing import ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from valerie.labels import PERSON, instance_id
from valerie.perception.base import FunctionCard
from valerie.rendering.annotations.flow import FlowMap
from valerie.rendering.annotations.normals import Normals
from valerie.rendering.base import GroundTruth, Layer, LinearImage, PersonTruth, Rectangle, TruthLayer, View
from valerie.rendering.engine import Engine
from valerie.rendering.person_light import Received
from valerie.scene.graph.model import Scene

NAME: Final = "blank"
ENGINE: Final = Engine("valerie.testing.blank:BlankRenderer")
NUMERIC_CLASS: Final = "blank"
_CLASS: Final = "VALERIE_TEST_BLANK_CLASS"
_SHIFT: Final = "VALERIE_TEST_BLANK_SHIFT"
#: Depth of every pixel, metres.
DEPTH: Final = 10.0


class BlankRenderer:
    """A gradient as background, and a square whose grey level follows from the poses of the movables."""

    name: ClassVar[str] = NAME
    revision: ClassVar[int] = 1

    @property
    def numeric_class(self) -> str:
        """See `valerie.rendering.base.Renderer`."""
        return _numeric_class()

    def background(self, scene: Scene, view: View) -> LinearImage:  # noqa: ARG002
        """See `Renderer`."""
        ramp = np.linspace(0.1, 0.9, view.width, dtype=np.float16) + np.float16(_shift())
        return LinearImage(np.broadcast_to(ramp[None, :, None], (view.height, view.width, 3)).copy())

    def layer(self, scene: Scene, view: View) -> Layer:
        """See `Renderer`."""
        rectangle = _square(view)
        level = np.float16(int.from_bytes(_movables(scene)[:2], "big") / 65_536)
        return Layer(rectangle, np.full((rectangle.height, rectangle.width, 3), level, np.float16))

    def full(self, scene: Scene, view: View) -> LinearImage:
        """See `Renderer`."""
        return self.layer(scene, view).over(self.background(scene, view))

    def received(self, scene: Scene, view: View, rectangles: Sequence[Rectangle]) -> list[Received]:  # noqa: ARG002
        """See `valerie.rendering.person_light.LightPass`: half of the light is from the sun, which shines everywhere."""
        received = []
        for rectangle in rectangles:
            samples = np.full((rectangle.height, rectangle.width, 4), 0.25, np.float32)
            samples[..., 2:] = 1.0, DEPTH
            received.append(Received(rectangle, samples, 1.0, sunny=True))
        return received

    def close(self) -> None:
        """Nothing is held."""


class BlankTruthPass:
    """Road everywhere, and one person in the square."""

    revision: ClassVar[int] = 1

    @property
    def numeric_class(self) -> str:
        """See `valerie.rendering.base.Renderer`."""
        return _numeric_class()

    def truth(self, scene: Scene, view: View) -> GroundTruth:
        """See `valerie.rendering.truth.TruthMaker`."""
        statics, layer = self.parts(scene, view)
        return layer.over(statics)

    def parts(self, scene: Scene, view: View) -> tuple[GroundTruth, TruthLayer]:  # noqa: ARG002
        """See `valerie.rendering.truth.TruthMaker`."""
        square, size, number = _square(view), (view.height, view.width), instance_id(PERSON, 1)
        count = square.width * square.height
        mask = np.ones((square.height, square.width), np.bool_)
        statics = GroundTruth(
            np.full(size, 7, np.uint8), np.zeros(size, np.uint16), np.full(size, DEPTH, np.float32), ()
        )
        layer = TruthLayer(
            square,
            mask,
            np.full(count, PERSON.id, np.uint8),
            np.full(count, number, np.uint16),
            np.full(count, DEPTH, np.float32),
            (PersonTruth(number, square, mask, count, size),),
            size,
        )
        return statics, layer

    def part(self, scene: Scene, view: View, window: Rectangle) -> GroundTruth:
        """See `valerie.rendering.truth.TruthMaker`: the square is one pixel further right for each metre of the person's x."""
        whole, inside, right = self.truth(scene, view), window.slices, round(_first_x(scene))
        (person,) = whole.persons
        return GroundTruth(
            np.roll(whole.class_map, right, axis=1)[inside],
            np.roll(whole.instance_map, right, axis=1)[inside],
            whole.depth[inside],
            (PersonTruth.of(person.instance_id, np.roll(person.amodal, right, axis=1), person.padded_pixels),),
        )

    def normals(self, scene: Scene, view: View) -> Normals:  # noqa: ARG002
        """See `valerie.rendering.truth.TruthMaker`: every normal points up."""
        return Normals.of(np.broadcast_to(np.array([0.0, 0.0, 1.0]), (view.height, view.width, 3)))

    def flow(self, now: Scene, then: Scene, view: View, truth: GroundTruth) -> FlowMap:
        """See `valerie.rendering.truth.TruthMaker`: the square moves right by one pixel per metre of the person's motion."""
        return FlowMap(_sideways(truth, _first_x(then) - _first_x(now), view))

    def velocity(self, now: Scene, after: Scene, view: View, truth: GroundTruth, seconds: float) -> FlowMap:
        """See `valerie.rendering.truth.TruthMaker`: the flow per second."""
        return FlowMap(_sideways(truth, (_first_x(after) - _first_x(now)) / seconds, view))

    def close(self) -> None:
        """Nothing is held."""


class BlankFunction:
    """A function that predicts a person wherever the picture is darker than middle grey."""

    revision: ClassVar[int] = 1

    @property
    def numeric_class(self) -> str:
        """See `valerie.rendering.base.Renderer`."""
        return _numeric_class()

    card = FunctionCard(NAME, hashlib.sha256(b"blank").hexdigest(), NAME, "uint8", NAME, {})

    def predict(self, picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """See `PerceptionFunction`."""
        predicted = np.zeros(picture.shape[:2], np.uint8)
        predicted[picture[..., 0] < 128 + 255 * _shift()] = PERSON.train_id
        return predicted

    def close(self) -> None:
        """Nothing is held."""


def _numeric_class() -> str:
    return os.environ.get(_CLASS, NUMERIC_CLASS)


def _shift() -> float:
    return float(os.environ.get(_SHIFT, "0"))


def _square(view: View) -> Rectangle:
    return Rectangle(view.width // 4, view.height // 4, view.width // 2, view.height // 2)


def _first_x(scene: Scene) -> float:
    node = next((node for node in scene.nodes.values() if node.label_id == PERSON.id), None)
    return 0.0 if node is None else float(node.transform[0, 3])


def _sideways(truth: GroundTruth, pixels: float, view: View) -> NDArray[np.float32]:
    vectors = np.zeros((view.height, view.width, 2), np.float32)
    vectors[truth.class_map == PERSON.id, 0] = pixels
    return vectors


def _movables(scene: Scene) -> bytes:
    digest = hashlib.sha256()
    for path, node in scene.nodes.items():
        if node.movable and node.visible:
            digest.update(path.encode() + np.ascontiguousarray(node.transform).tobytes())
    return digest.digest()
