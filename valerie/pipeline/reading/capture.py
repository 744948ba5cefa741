"""How one sensor setting sees one frame: the picture, and the truth in step with it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from valerie.db.products import Job
from valerie.parameters.assignment import digest
from valerie.pipeline.reading.products import ProductReader
from valerie.rendering.base import GroundTruth, PersonTruth
from valerie.runs.sensors import focal_length_mm, setting_of, short_document
from valerie.runs.spec import ResolvedRun
from valerie.sensing.distortion import pixel_map, shown_within
from valerie.sensing.sensor import REVISION, Shot, develop, focal_length_px, seen_from
from valerie.sensing.settings import SensorSetting


@dataclass(frozen=True, slots=True)
class Capture:
    """A frame and the camera that takes it.

    Attributes:
        background, layer, truth: digests of the frame's products.
        setting: with the variant's own values put in; without a shutter where there are no velocities.
        focal_length_mm: of the camera in this variant; None where the asset does not tell and the setting does not ask.
        run_seed: of the run.
        velocity: digest, where the run has velocities.
    """

    background: str
    layer: str
    truth: str
    setting: SensorSetting
    focal_length_mm: float | None
    run_seed: int
    velocity: str | None = None

    @property
    def distorted(self) -> bool:
        """Whether the truth as seen differs from the frame's."""
        return self.setting.moves_truth

    @property
    def tag(self) -> str:
        """32 hexadecimal characters that stand for all of it."""
        products = [self.background, self.layer, self.truth]
        if self.velocity is not None and self.setting.needs_velocity:
            products.append(self.velocity)
        return digest("capture", REVISION, products, short_document(self.setting, self.run_seed))

    def zoom(self, width: int, height: int) -> float:
        """How much the picture is enlarged so that a distorting lens shows no more than was rendered; 1 without distortion."""
        if self.setting.distortion.identity or self.focal_length_mm is None:
            return 1.0
        return pixel_map(self.setting.distortion, width, height, focal_length_px(self.focal_length_mm, width)).zoom

    def picture(self, reader: ProductReader) -> NDArray[np.uint8]:
        """What a function under test sees: (H, W, 3) uint8 sRGB.

        Raises:
            MissingInput: an object is gone.
        """
        image = reader.frame(self.background, self.layer)
        depth = reader.truth(self.truth).depth if self.setting.needs_depth else None
        shot = Shot(self.focal_length_mm, depth, self._moving(reader), self.run_seed, (self.background, self.layer))
        return develop(image.pixels, self.setting, shot)

    def _moving(self, reader: ProductReader) -> NDArray[np.float32] | None:
        if self.velocity is None or not self.setting.needs_velocity:
            return None
        return reader.velocity(self.velocity).vectors

    def seen_from(self, reader: ProductReader, truth: GroundTruth) -> NDArray[np.intp]:
        """(H, W) flat index of the rendered pixel that each pixel of the picture shows; ``truth`` is the frame's own."""
        height, width = truth.class_map.shape
        velocity = self._moving(reader)
        focal = self.focal_length_mm
        return seen_from(self.setting, width, height, focal_length_mm=focal, depth=truth.depth, velocity=velocity)

    def seen_map(self, reader: ProductReader, pixels: NDArray[Any]) -> NDArray[Any]:
        """(H, W, …) of the rendered image, in step with the picture: by the nearest pixel of the map that moves the image."""
        if not self.distorted:
            return pixels
        height, width = pixels.shape[:2]
        index = self.seen_from(reader, reader.truth(self.truth))
        moved: NDArray[Any] = pixels.reshape(height * width, *pixels.shape[2:])[index]
        return moved

    def seen_truth(self, reader: ProductReader) -> GroundTruth:
        """The ground truth in step with the picture.

        Raises:
            MissingInput: an object is gone.
        """
        truth = reader.truth(self.truth)
        if not self.distorted:
            return truth
        return moved_truth(truth, self.setting, self.seen_from(reader, truth), self.focal_length_mm)


def capture_of(
    resolved: ResolvedRun,
    *,
    sensor_index: int,
    camera_index: int,
    assignment: Mapping[str, Any],
    background: str,
    layer: str,
    truth: str,
    velocity: str | None = None,
) -> Capture:
    """The capture of a frame of a run.

    Args:
        resolved: the run.
        sensor_index, camera_index: places in the run's sensors and cameras.
        assignment: of the variant at the frame's moment (`ResolvedRun.at`).
        background, layer, truth: digests of the frame's products.
        velocity: likewise, where the run has velocities.
    """
    return Capture(
        background=background,
        layer=layer,
        truth=truth,
        setting=setting_of(resolved.spec.sensors[sensor_index], assignment, moves=velocity is not None),
        focal_length_mm=focal_length_mm(resolved.manifest, resolved.cameras[camera_index], assignment),
        run_seed=resolved.spec.seed,
        velocity=velocity,
    )


def capture_of_job(resolved: ResolvedRun, job: Job) -> Capture:
    """The capture that a prediction or an evaluation of a run is about."""
    assert job.sensor_index is not None, "predictions and evaluations have a sensor"
    return capture_of(
        resolved,
        sensor_index=job.sensor_index,
        camera_index=job.camera_index,
        assignment=resolved.at(job.assignment, job.time_index),
        background=job.background,
        layer=job.layer,
        truth=job.truth,
        velocity=job.velocity,
    )


def moved_truth(
    truth: GroundTruth, setting: SensorSetting, index: NDArray[np.intp], focal_length: float | None
) -> GroundTruth:
    """Ground truth as a sensor shows it: every map by the nearest pixel of the same map that moves the image.

    What of a person lies beyond the border of the rendered image has no pixels to be moved. The whole person is therefore
    counted in pixels of the picture by the share of it that the picture shows, so that the truncation rate is the share of
    the person's pinhole pixels (on the padded canvas) that are not shown.

    Args:
        truth: of the pinhole camera, at the frame's moment.
        setting: its distortion counts.
        index: (H, W) which pixel of it each pixel of the picture shows (`Capture.seen_from`).
        focal_length: millimetres, on a sensor 36 mm wide; where the lens distorts.
    """
    height, width = truth.class_map.shape
    within = np.ones((height, width), np.bool_)
    if not setting.distortion.identity and focal_length is not None:
        focal_px = focal_length_px(focal_length, width)
        zoom = pixel_map(setting.distortion, width, height, focal_px).zoom
        within = shown_within(setting.distortion, width, height, focal_px, zoom)

    def person(one: PersonTruth) -> PersonTruth:
        amodal = one.amodal.ravel()[index]
        shown, seen = int(np.count_nonzero(one.mask & within[one.box.slices])), int(np.count_nonzero(amodal))
        whole = round(one.padded_pixels * seen / shown) if shown and seen else one.padded_pixels
        return PersonTruth.of(one.instance_id, amodal, max(whole, seen))

    return GroundTruth(
        class_map=truth.class_map.ravel()[index],
        instance_map=truth.instance_map.ravel()[index],
        depth=truth.depth.ravel()[index],
        persons=tuple(person(one) for one in truth.persons),
    )
