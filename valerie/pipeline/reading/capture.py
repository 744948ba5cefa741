"""One frame through one sensor setting: the picture, and the truth that matches it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from valerie.db.links import StoredFrame
from valerie.parameters.assignment import digest
from valerie.pipeline.reading.product_reader import ProductReader
from valerie.rendering.base import WHOLE, GroundTruth, PersonTruth, Window
from valerie.rendering.label_policy import LabelPolicy, labelled
from valerie.runs.products.frame_keys import FrameProducts
from valerie.runs.resolving.sensors import focal_length_mm, setting_of, short_document
from valerie.runs.resolving.spec import ResolvedRun
from valerie.sensing.distortion import pixel_map, shown_within
from valerie.sensing.sensor import REVISION, Shot, develop, focal_length_px, seen_from
from valerie.sensing.settings import SensorSetting


@dataclass(frozen=True, slots=True)
class Capture:
    """A frame and the sensor that captures it.

    Attributes:
        products: digests of the frame's products.
        setting: the sensor setting with the variant's own values; without a shutter where nothing moves.
        focal_length_mm: focal length of the camera in this variant; None if the asset does not declare it.
        run_seed: seed of the run.
        labels: label policy of the run.
    """

    products: FrameProducts
    setting: SensorSetting
    focal_length_mm: float | None
    run_seed: int
    labels: LabelPolicy = LabelPolicy.EXACT

    @property
    def distorted(self) -> bool:
        """True if the truth in the picture differs from the frame's."""
        return self.setting.moves_truth

    @property
    def motion(self) -> str | None:
        """Digest of the scan or of the velocities that the picture depends on; None without either."""
        if self.setting.rolls:
            return self.products.scan
        return self.products.velocity if self.setting.needs_velocity else None

    @property
    def tag(self) -> str:
        """Digest of everything that the picture and its labels depend on, 32 hexadecimal characters."""
        products = list(self.products.required)
        if self.motion is not None:
            products.append(self.motion)
        return digest("capture", REVISION, products, short_document(self.setting, self.run_seed), self.labels.value)

    def zoom(self, width: int, height: int) -> float:
        """Return the factor that enlarges the picture so that a distorting lens shows only rendered pixels.

        1 without distortion.
        """
        if self.setting.distortion.identity or self.focal_length_mm is None:
            return 1.0
        return pixel_map(self.setting.distortion, width, height, focal_length_px(self.focal_length_mm, width)).zoom

    def picture(self, reader: ProductReader, window: Window = WHOLE) -> NDArray[np.uint8]:
        """Develop the picture that a function under test sees: (H, W, 3) uint8 sRGB.

        Args:
            reader: of the store.
            window: what to develop, with noise of its own; a part only if the setting is `pixelwise`.

        Raises:
            MissingInput: an object is gone.
        """
        image, velocity = reader.frame(self.products, window), None
        depth = self._truth(reader).depth if self.setting.needs_depth else None
        if self.setting.rolls and self.products.scan is not None:
            scan = reader.scan(self.products.scan)
            image, velocity = scan.image(image), scan.velocity if self.setting.needs_velocity else None
        elif self.setting.needs_velocity and self.products.velocity is not None:
            velocity = reader.velocity(self.products.velocity).vectors
        content = (self.products.background, self.products.layer)
        metered = reader.metered_ev(self.products.background) if self.setting.auto_exposure else None
        shot = Shot(self.focal_length_mm, depth, velocity, self.run_seed, content, metered)
        return develop(image.pixels, self.setting, shot)

    def empty_picture(self, reader: ProductReader) -> NDArray[np.uint8]:
        """Develop the background without movables: (H, W, 3) uint8 sRGB.

        Raises:
            MissingInput: an object is gone.
            InvalidInput: the sensor needs depths or velocities, which exist only for the whole frame.
        """
        background = self.products.background
        metered = reader.metered_ev(background) if self.setting.auto_exposure else None
        shot = Shot(self.focal_length_mm, None, None, self.run_seed, (background,), metered)
        return develop(reader.background(background).pixels, self.setting, shot)

    def seen_map(self, pixels: NDArray[Any]) -> NDArray[Any]:
        """Distort a map of the rendered image, (H, W, …), like the lens, by the nearest pixel.

        A rolling shutter does not change it: it stays at the frame's moment.
        """
        if self.setting.distortion.identity:
            return pixels
        height, width = pixels.shape[:2]
        index = seen_from(self.setting, width, height, focal_length_mm=self.focal_length_mm)
        moved: NDArray[Any] = pixels.reshape(height * width, *pixels.shape[2:])[index]
        return moved

    def seen_truth(self, reader: ProductReader) -> GroundTruth:
        """Read the ground truth that matches the picture, with the labels of the run.

        Raises:
            MissingInput: an object is gone.
            MissingDependency: labels that are not exact need OpenCV.
        """
        truth = labelled(self._truth(reader), self.labels)
        if self.setting.distortion.identity:
            return truth
        height, width = truth.class_map.shape
        index = seen_from(self.setting, width, height, focal_length_mm=self.focal_length_mm)
        return moved_truth(truth, self.setting, index, self.focal_length_mm)

    def seen_classes(self, reader: ProductReader) -> NDArray[np.uint8]:
        """Read the classes of `seen_truth` alone: (H, W) uint8, in less time where nothing moves them."""
        if self.distorted or self.labels is not LabelPolicy.EXACT:
            return self.seen_truth(reader).class_map
        return reader.class_map(self.products.truth)

    def _truth(self, reader: ProductReader) -> GroundTruth:
        """Read the exact ground truth of the rendered image, or of its scan by a rolling shutter."""
        truth = reader.truth(self.products.truth)
        if not self.setting.rolls or self.products.scan is None:
            return truth
        return reader.scan(self.products.scan).truth(truth)


def capture_of(resolved: ResolvedRun, frame: StoredFrame, sensor: int) -> Capture:
    """Return the capture of a frame of the run by one of its sensors.

    Args:
        resolved: the run.
        frame: one of its frames.
        sensor: index in the sensors of the run's spec.
    """
    assignment = resolved.at(frame.assignment, frame.key.time)
    moves = resolved.times.motion is not None
    return Capture(
        products=frame.products,
        setting=setting_of(resolved.spec.sensors[sensor], assignment, moves=moves),
        focal_length_mm=focal_length_mm(resolved.manifest, resolved.cameras[frame.key.camera], assignment),
        run_seed=resolved.spec.seed,
        labels=resolved.spec.labels,
    )


def moved_truth(
    truth: GroundTruth, setting: SensorSetting, index: NDArray[np.intp], focal_length: float | None
) -> GroundTruth:
    """Return the ground truth as a sensor shows it: every map is sampled at the nearest pixel.

    The part of a person beyond the border of the rendered image has no pixels to move. The number of pixels of the whole
    person is therefore scaled by the ratio of its pixels in the picture to its pinhole pixels in the area that the picture
    shows. So the truncation rate is the share of the person's pinhole pixels (on the padded canvas) that the picture does
    not show.

    Args:
        truth: truth of the pinhole camera, at the frame's moment.
        setting: the sensor; only its distortion counts.
        index: (H, W) pixel of the truth that each pixel of the picture shows (`valerie.sensing.sensor.seen_from`).
        focal_length: millimetres, on a sensor 36 mm wide; required if the lens distorts.
    """
    height, width = truth.class_map.shape
    within = np.ones((height, width), np.bool_)
    if not setting.distortion.identity and focal_length is not None:
        focal_px = focal_length_px(focal_length, width)
        zoom = pixel_map(setting.distortion, width, height, focal_px).zoom
        within = shown_within(setting.distortion, width, height, focal_px, zoom)

    def moved(person: PersonTruth) -> PersonTruth:
        amodal = person.amodal.ravel()[index]
        shown, seen = int(np.count_nonzero(person.mask & within[person.box.slices])), int(np.count_nonzero(amodal))
        whole = round(person.padded_pixels * seen / shown) if shown and seen else person.padded_pixels
        return PersonTruth.of(person.instance_id, amodal, max(whole, seen))

    return GroundTruth(
        class_map=truth.class_map.ravel()[index],
        instance_map=truth.instance_map.ravel()[index],
        depth=truth.depth.ravel()[index],
        persons=tuple(moved(person) for person in truth.persons),
    )
