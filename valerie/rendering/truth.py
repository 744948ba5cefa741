"""What a truth pass is: a scene and a view in, ground truth out, for all engines."""

from __future__ import annotations

from typing import ClassVar, Protocol

from valerie.rendering.annotations.flow import FlowMap
from valerie.rendering.annotations.normals import Normals
from valerie.rendering.base import GroundTruth, TruthLayer, View
from valerie.scene.graph.model import Scene


class TruthMaker(Protocol):
    """Makes the ground truth of scenes; one instance per process, since it may own a GL context.

    Each method raises `UnknownName` where the scene has no such camera.
    """

    #: Raised by hand whenever the truth of some geometry changes; part of every truth's digest.
    revision: ClassVar[int]

    @property
    def numeric_class(self) -> str:
        """The arithmetic that decides on which side of a pixel centre an edge falls."""
        ...

    def truth(self, scene: Scene, view: View) -> GroundTruth:
        """Return the truth of a scene seen by a camera."""
        ...

    def parts(self, scene: Scene, view: View) -> tuple[GroundTruth, TruthLayer]:
        """Return the truth of the scene without its movables, and what they change in it.

        The first is the same object from call to call while the camera is kept. It has no masks of persons: they are all in
        the layer.
        """
        ...

    def normals(self, scene: Scene, view: View) -> Normals:
        """Return which way the surface in each pixel faces, in step with `truth`."""
        ...

    def flow(self, now: Scene, then: Scene, view: View, truth: GroundTruth) -> FlowMap:
        """Return how far, in pixels, each point that is seen now lies aside at another moment; ``truth`` is of now."""
        ...

    def velocity(self, now: Scene, after: Scene, view: View, truth: GroundTruth, seconds: float) -> FlowMap:
        """Return the same in pixels per second, measured over ``seconds`` from now."""
        ...

    def close(self) -> None:
        """Free the context; the instance is unusable afterwards."""
        ...
