"""``python -m valerie.pipeline.work.preview_process``: small pictures of variants, for the process that started this one.

`valerie.pipeline.control.preview` sends one job after the other over standard input, as JSON behind its length, and gets the
pictures back in the same way. The asset stays in memory between them. This process ends with its parent, at its limit of
memory, and when no job comes for a while.
"""

from __future__ import annotations

import base64
import io
import os
import select
import sys
from pathlib import Path
from typing import Final

from valerie import plugins
from valerie.document import Document
from valerie.errors import MissingDependency, TransientError, ValerieError
from valerie.parameters.definitions import Value
from valerie.parent import end_with_parent, read_message, write_message
from valerie.perception.running.limits import limit_memory
from valerie.rendering.base import Renderer, View
from valerie.rendering.truth import TruthMaker
from valerie.scene.assets.asset import SceneAsset, load_asset
from valerie.scene.variation.variant import apply
from valerie.sensing.metering import metered_ev
from valerie.sensing.sensor import Shot, develop
from valerie.sensing.settings import SensorSetting

_IDLE_SECONDS: Final = 180.0
_MEMORY_MB: Final = 6_144


class PreviewFrame(Document):
    """A frame to render.

    Attributes:
        values: path to value, at the moment of the frame.
        sensor: the setting with the variant's values.
        focal_length_mm: of the camera; None where the asset does not tell.
    """

    values: dict[str, Value]
    sensor: SensorSetting
    focal_length_mm: float | None


class PreviewJob(Document):
    """Frames of one asset to render.

    Attributes:
        renderer: engine.
        settings: of the engine.
        asset: name, or name and arguments.
        asset_dir: folder of users' assets.
        camera: name.
        width, height: of the pictures, pixels.
        seed: of the run.
        frames: to render, in order.
    """

    renderer: str
    settings: dict[str, Value]
    asset: str | dict[str, Value]
    asset_dir: Path
    camera: str
    width: int
    height: int
    seed: int
    frames: tuple[PreviewFrame, ...]


class PreviewAnswer(Document):
    """The answer to a job.

    Attributes:
        pictures: PNG files in base 64, one for each frame; empty with an error.
        error: why there are none.
        engine_missing: True if this machine lacks the engine, or the engine ended.
    """

    pictures: tuple[str, ...] = ()
    error: str | None = None
    engine_missing: bool = False


def main() -> None:
    """Answer jobs until the parent ends or nobody asks any more."""
    end_with_parent()
    limit_memory(_MEMORY_MB)
    requests, answers = sys.stdin.buffer, os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a driver prints is no answer
    studio = _Studio()
    while select.select([requests], [], [], _IDLE_SECONDS)[0]:
        request = read_message(requests)
        if request is None:
            return
        answer = studio.answer(PreviewJob.model_validate_json(request))
        write_message(answers, answer.model_dump_json().encode())


class _Studio:
    """Engines, truth pass and the latest asset, opened when they are needed."""

    def __init__(self) -> None:
        self._engines: dict[str, tuple[dict[str, Value], Renderer]] = {}
        self._truth: TruthMaker | None = None
        self._asset: tuple[object, SceneAsset] | None = None

    def answer(self, job: PreviewJob) -> PreviewAnswer:
        try:
            engine = self._opened(job.renderer, job.settings)
            return PreviewAnswer(pictures=tuple(self._picture(engine, job, frame) for frame in job.frames))
        except (MissingDependency, TransientError) as error:
            return PreviewAnswer(error=str(error), engine_missing=True)
        except (ValerieError, MemoryError) as error:
            return PreviewAnswer(error=str(error) or f"more than {_MEMORY_MB} MB are needed")

    def _opened(self, name: str, settings: dict[str, Value]) -> Renderer:
        """Return the engine; another one is opened where the settings differ from those of the last job."""
        entry = self._engines.get(name)
        if entry is not None and entry[0] == settings:
            return entry[1]
        if entry is not None:
            del self._engines[name]
            entry[1].close()
        engine = plugins.create_renderer(name, settings)
        self._engines[name] = (settings, engine)
        return engine

    def _picture(self, engine: Renderer, job: PreviewJob, frame: PreviewFrame) -> str:
        from PIL import Image

        scene = apply(frame.values, self._loaded(job))
        view = View(job.camera, job.width, job.height)
        background = engine.background(scene, view)
        image = engine.layer(scene, view).over(background)
        depth = None
        if frame.sensor.needs_depth:
            self._truth = self._truth or plugins.create_truth_pass(engine.numeric_class)
            statics, layer = self._truth.parts(scene, view)
            depth = layer.over(statics).depth
        metered = metered_ev(background.pixels) if frame.sensor.auto_exposure else None
        shot = Shot(frame.focal_length_mm, depth, None, job.seed, (), metered)
        file = io.BytesIO()
        Image.fromarray(develop(image.pixels, frame.sensor, shot)).save(file, "PNG", compress_level=1)
        return base64.b64encode(file.getvalue()).decode()

    def _loaded(self, job: PreviewJob) -> SceneAsset:
        key = (job.asset, job.asset_dir)
        if self._asset is None or self._asset[0] != key:
            self._asset = (key, load_asset(job.asset, asset_dir=job.asset_dir))
        return self._asset[1]


if __name__ == "__main__":
    main()
