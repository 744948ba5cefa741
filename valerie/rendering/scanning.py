"""Rolling shutter: a frame is read line by line, each line at its own moment.

The scene is rendered in slices. A slice holds the lines that are read before anything in them moves noticeably, and shows scene
and camera at the middle of that time. In the fastest scenes, a slice is one line. Nothing is warped: surfaces that come into
view are rendered, and labels are those of rays cast at each line's moment. Shading, shadows and reflections change per slice.

Source: C.-K. Liang et al., "Analysis and compensation of rolling shutter effect", IEEE TIP 17(8), 2008,
doi:10.1109/TIP.2008.925384 (the camera model).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from valerie.rendering.annotations.scan import Scan
from valerie.rendering.base import GroundTruth, LinearImage, PersonTruth, Rectangle, Renderer, View, bounds
from valerie.rendering.scene_reading import camera_key, camera_of
from valerie.rendering.truth import TruthMaker
from valerie.scene.graph.model import Scene, freeze

#: The farthest that a surface moves while the lines of one slice are read, pixels: for labels, and for the image.
_LABELS_MOVE, _IMAGE_MOVES = 0.25, 0.5
#: Share of all lines within which a surface counts for a line: it may arrive between the moments at which speeds are measured.
_AROUND: Final = 1 / 8
#: Number of moments at which speeds are measured; seconds of reading for each further one; largest number.
_MOMENTS, _ANOTHER_AFTER_S, _MOST_MOMENTS = 3, 0.1, 9
#: Seconds over which a speed is measured.
_SPAN_S: Final = 0.005

Lines = NDArray[np.intp]
#: Maps seconds after the frame's moment to the scene.
Moments = Callable[[float], Scene]


class Readout(NamedTuple):
    """The times at which a rolling shutter reads the pixels of a frame.

    Attributes:
        lines: (H, W) or (H, 1), the row of the picture that shows each rendered pixel; 0 is the middle of the picture, which is
            read at the frame's moment.
        line_time_s: seconds from one row to the next.
        blurs: True if velocities are requested.
    """

    lines: NDArray[np.float64]
    line_time_s: float
    blurs: bool = False


class _Whole:
    """The arrays of the whole image, filled slice by slice. They start as copies of the frame's."""

    def __init__(self, image: LinearImage, truth: GroundTruth, *, blurs: bool) -> None:
        self.pixels = image.pixels.copy()
        self.class_map, self.instance_map = truth.class_map.copy(), truth.instance_map.copy()
        self.depth = truth.depth.copy()
        self.vectors = np.zeros((*truth.depth.shape, 2), np.float32) if blurs else None
        self.amodal: dict[int, NDArray[np.bool_]] = {}

    def label(self, window: Rectangle, read: NDArray[np.bool_], part: GroundTruth) -> None:
        """Fill the labels of the pixels of a window that a slice reads, from a truth of the window's size."""
        inside = window.slices
        self.class_map[inside][read] = part.class_map[read]
        self.instance_map[inside][read] = part.instance_map[read]
        self.depth[inside][read] = part.depth[read]
        for person in part.persons:
            mask = self.amodal.setdefault(person.instance_id, np.zeros(self.depth.shape, np.bool_))
            mask[inside][read] = person.amodal[inside][read]

    def masks(self, persons: tuple[PersonTruth, ...]) -> Iterator[NDArray[np.bool_]]:
        """Yield the amodal mask of each person."""
        for person in persons:
            yield self.amodal.get(person.instance_id, np.zeros(self.depth.shape, np.bool_))


def _scan_of(image: LinearImage, truth: GroundTruth, whole: _Whole) -> Scan:
    """Return the difference from a frame's own image and truth."""
    differs = (whole.pixels.view(np.uint16) != image.pixels.view(np.uint16)).any(axis=2)
    differs |= (whole.class_map != truth.class_map) | (whole.instance_map != truth.instance_map)
    differs |= whole.depth.view(np.uint32) != truth.depth.view(np.uint32)
    if whole.vectors is not None:
        differs |= (whole.vectors != 0).any(axis=2)
    box = bounds(differs)
    part = box.slices
    persons = [
        PersonTruth.of(person.instance_id, mask, _beyond(person) + int(np.count_nonzero(mask)))
        for person, mask in zip(truth.persons, whole.masks(truth.persons), strict=True)
    ]
    return Scan(
        rectangle=_numbers(box),
        pixels=freeze(whole.pixels[part].copy()),
        class_map=freeze(whole.class_map[part].copy()),
        instance_map=freeze(whole.instance_map[part].copy()),
        depth=freeze(whole.depth[part].copy()),
        vectors=freeze(np.zeros((0, 0, 2), np.float32) if whole.vectors is None else whole.vectors[part].copy()),
        instances=np.array([person.instance_id for person in persons], np.int64),
        boxes=np.array([_numbers(person.box) for person in persons], np.int64).reshape(-1, 4),
        padded_pixels=np.array([person.padded_pixels for person in persons], np.int64),
        masks=np.concatenate([np.zeros(0, np.uint8), *(person.mask.ravel() for person in persons)], dtype=np.uint8),
        size=np.array(truth.class_map.shape, np.int64),
    )


def scan(
    engine: Renderer,
    truth_pass: TruthMaker,
    moments: Moments,
    view: View,
    frame: tuple[LinearImage, GroundTruth],
    reading: Readout,
) -> Scan:
    """Render a frame line by line.

    Args:
        engine: renders the image.
        truth_pass: renders the labels.
        moments: the scene around the frame's moment.
        frame: its image and truth, at its moment.
        reading: the times at which the lines are read.
    """
    image, truth = frame
    lines, line_time_s, blurs = reading
    whole = _Whole(image, truth, blurs=blurs)
    first = lines.min()
    numbers = np.broadcast_to(np.floor(lines - first + 0.5).astype(np.intp), truth.depth.shape)
    speeds = _speeds(truth_pass, moments, view, numbers, line_time_s)

    def slices(within: float) -> Iterator[tuple[Scene, float, Rectangle, NDArray[np.bool_]]]:
        for start, stop in sliced(speeds * line_time_s, within):
            read = (numbers >= start) & (numbers < stop)
            window = bounds(read)
            if not window.empty:
                seconds = (0.5 * (start + stop - 1) + first) * line_time_s
                yield moments(seconds), seconds, window, read[window.slices]

    for scene, seconds, window, read in slices(_LABELS_MOVE):
        if whole.vectors is None:
            whole.label(window, read, truth_pass.part(scene, view, window))
            continue
        now = truth_pass.truth(scene, view)
        velocity = truth_pass.velocity(scene, moments(seconds + _SPAN_S), view, now, _SPAN_S).vectors
        whole.label(window, read, _cropped(now, window))
        whole.vectors[window.slices][read] = velocity[window.slices][read]
    _warm(engine, moments, view, line_time_s * len(speeds))
    for scene, _, window, read in slices(_IMAGE_MOVES):
        whole.pixels[window.slices][read] = _pixels(engine, scene, view, window)[read]
    return _scan_of(image, truth, whole)


def sliced(moves: NDArray[np.float64], within: float) -> Iterator[tuple[int, int]]:
    """Yield the first line of each slice and the line after its last.

    Args:
        moves: per line, the distance that its fastest surface moves until the next line, pixels.
        within: the farthest that a surface may move while a slice is read; a slice has at least one line.
    """
    start, fastest = 0, 0.0
    for line, move in enumerate(moves.tolist()):
        fastest = max(fastest, move)
        if line > start and (line + 1 - start) * fastest > within:
            yield start, line
            start, fastest = line, move
    if len(moves):
        yield start, len(moves)


def _speeds(
    truth_pass: TruthMaker, moments: Moments, view: View, numbers: Lines, line_time_s: float
) -> NDArray[np.float64]:
    """Return the highest speed around each line while the frame is read, pixels per second."""
    from scipy.ndimage import maximum_filter1d

    count = int(numbers.max()) + 1
    half = 0.5 * (count - 1) * line_time_s
    speeds = np.zeros(count)
    count = min(_MOMENTS + int(2 * half / _ANOTHER_AFTER_S), _MOST_MOMENTS)
    for seconds in np.linspace(-half, half, count).tolist():
        scene, after = moments(seconds), moments(seconds + _SPAN_S)
        vectors = truth_pass.velocity(scene, after, view, truth_pass.truth(scene, view), _SPAN_S).vectors
        np.maximum.at(speeds, numbers, np.hypot(vectors[..., 0], vectors[..., 1]))
    around: NDArray[np.float64] = maximum_filter1d(speeds, 2 * int(count * _AROUND) + 1, mode="nearest")
    return around


def _warm(engine: Renderer, moments: Moments, view: View, seconds: float) -> None:
    """Render the background once if the camera does not move. The engine caches it, and each slice draws only the movables."""
    scenes = [moments(seconds * share) for share in (-0.5, 0.0, 0.5)]
    if len({camera_key(camera_of(scene, view), view) for scene in scenes}) == 1:
        engine.background(scenes[1], view)


def _pixels(engine: Renderer, scene: Scene, view: View, window: Rectangle) -> NDArray[np.float16]:
    part: Callable[[Scene, View, Rectangle], NDArray[np.float16]] | None = getattr(engine, "part", None)
    return engine.full(scene, view).pixels[window.slices] if part is None else part(scene, view, window)


def _cropped(truth: GroundTruth, window: Rectangle) -> GroundTruth:
    inside = window.slices
    return GroundTruth(
        truth.class_map[inside].copy(), truth.instance_map[inside].copy(), truth.depth[inside].copy(), truth.persons
    )


def _beyond(person: PersonTruth) -> int:
    """Return the number of a person's pixels outside the image, at the frame's moment."""
    return person.padded_pixels - int(np.count_nonzero(person.mask))


def _numbers(box: Rectangle) -> NDArray[np.int64]:
    return np.array([box.x, box.y, box.width, box.height], np.int64)
