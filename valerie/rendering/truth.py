"""The interface of the truth pass, which turns a scene and a view into ground truth for all engines."""

from __future__ import annotations

from typing import ClassVar, Protocol

from valerie.rendering.annotations.flow import FlowMap
from valerie.rendering.annotations.normals import Normals
from valerie.rendering.base import GroundTruth, Rectangle, TruthLayer, View
from valerie.scene.graph.model import Scene


class TruthMaker(Protocol):
    """A source of ground truth. There is one instance per process, since it may own a GL context.

    Each method raises `UnknownName` if the scene has no such camera.
    """

    #: Part of every truth's digest. Raise it by hand whenever the truth of some geometry changes.
    revision: ClassVar[int]

    @property
    def numeric_class(self) -> str:
        """Name of the arithmetic that decides on which side of a pixel centre an edge falls."""
        ...

    def truth(self, scene: Scene, view: View) -> GroundTruth:
        """Return the ground truth of a scene seen by a camera."""
        ...

    def parts(self, scene: Scene, view: View) -> tuple[GroundTruth, TruthLayer]:
        """Return the ground truth without movables, and the layer that the movables change.

        The ground truth without movables is the same object at each call while its camera stays in the cache. It has no
        person masks: the layer has them all.
        """
        ...

    def part(self, scene: Scene, view: View, window: Rectangle) -> GroundTruth:
        """Return the ground truth of a rectangle of the image.

        The maps have its size. The amodal masks are those of `truth` within it; pixels beyond are not counted.
        """
        ...

    def normals(self, scene: Scene, view: View) -> Normals:
        """Return the surface normal at each pixel centre, for the surfaces of `truth`."""
        ...

    def flow(self, now: Scene, then: Scene, view: View, truth: GroundTruth) -> FlowMap:
        """Return the optical flow from ``now`` to ``then``, in pixels. ``truth`` is the ground truth of ``now``."""
        ...

    def velocity(self, now: Scene, after: Scene, view: View, truth: GroundTruth, seconds: float) -> FlowMap:
        """Return the image velocity, pixels per second: the flow to ``after``, ``seconds`` later, divided by that time."""
        ...

    def close(self) -> None:
        """Free the context. The instance is unusable afterwards."""
        ...
