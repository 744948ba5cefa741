"""Render frames to train on: streets of seeds that no run uses by default, random scenes, exact labels.

Training streets have seeds from 1000 on, held-out ones 900 to 999; seed 0, the default of every run, is in neither.
"""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Annotated, Final, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from valerie.errors import InvalidInput, RenderingError
from valerie.labels import to_train_ids
from valerie.perception.training.frames import FrameFolder, Shard, TrainingFrame, write_index, write_shard
from valerie.pipeline import training_scenes
from valerie.pipeline.training_scenes import crowd_asset, draw_scene
from valerie.rendering.base import View
from valerie.scene.asset import SceneAsset, asset_manifest, load_asset
from valerie.sensing import sensor
from valerie.sensing.sensor import develop

Split = Literal["train", "held-out"]

#: Street seeds of each split.
SEEDS: Final[dict[Split, range]] = {"train": range(1000, 100_000), "held-out": range(900, 1000)}
_TRIES: Final = 10


class FrameSettings(BaseModel):
    """Which frames to render.

    Attributes:
        split: ``train`` or ``held-out``: which seeds.
        streets: number of streets.
        per_street: frames of each.
        width, height: pixels.
        asset: a generated asset that takes a ``seed``.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    split: Split = "train"
    streets: Annotated[int, Field(ge=1)] = 100
    per_street: Annotated[int, Field(ge=1, le=10_000)] = 30
    width: Annotated[int, Field(ge=32, le=8192)] = 960
    height: Annotated[int, Field(ge=32, le=8192)] = 540
    asset: str = "urban-street"

    def seeds(self) -> range:
        """Street seeds, ascending.

        Raises:
            InvalidInput: the split has fewer.
        """
        seeds = SEEDS[self.split]
        if self.streets > len(seeds):
            raise InvalidInput("more streets than seeds", field="streets", value=self.streets, limit=len(seeds))
        return seeds[: self.streets]


def render_frames(
    folder: Path,
    settings: FrameSettings,
    *,
    processes: int = 1,
    progress: Callable[[Shard], None] = lambda _: None,
) -> FrameFolder:
    """Render all streets into a folder; frames depend on settings, seed and number only, not on processes.

    Args:
        folder: made if missing; must not hold frames already.
        settings: what to render.
        processes: each has a GL context of its own.
        progress: called after every street.

    Raises:
        InvalidInput: the folder holds frames already, or the settings cannot be met.
        RenderingError, MissingDependency: as the raster engine.
    """
    seeds = settings.seeds()
    folder.mkdir(parents=True, exist_ok=True)
    if any(folder.iterdir()):
        raise InvalidInput("the folder is not empty", field="folder", value=str(folder))
    shards: list[Shard] = []
    # Fresh processes: a GL context does not survive a fork.
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(max(1, processes), mp_context=spawn) as pool:
        waiting = [pool.submit(render_street, folder, seed, settings) for seed in seeds]
        try:
            for future in as_completed(waiting):
                shards.append(future.result())
                progress(shards[-1])
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
        numeric_class = pool.submit(_numeric_class).result()
    write_index(folder, shards, _provenance(settings, seeds, numeric_class))
    return FrameFolder(folder)


def render_street(folder: Path, seed: int, settings: FrameSettings) -> Shard:
    """Render the frames of one street in this process, and write its shard."""
    asset = load_asset({"name": settings.asset, "seed": seed})
    return write_shard(folder, seed, frames_of(asset, seed, settings))


def frames_of(asset: SceneAsset, seed: int, settings: FrameSettings) -> Iterator[TrainingFrame]:
    """The frames of one street, one after the other, from this process's GL context.

    Args:
        asset: the street.
        seed: of the street, and of everything that is drawn.
        settings: number and size of frames.

    Raises:
        RenderingError: no usable image after several draws.
    """
    from valerie.rendering.ground_truth import TruthPass
    from valerie.rendering.raster.context import process_context
    from valerie.rendering.raster.renderer import RasterRenderer

    context = process_context()
    renderer, truth_pass = RasterRenderer(context), TruthPass(context)
    crowd = crowd_asset(asset)
    try:
        for number in range(settings.per_street):
            for attempt in range(_TRIES):
                drawn = draw_scene(crowd, np.random.default_rng([training_scenes.REVISION, seed, number, attempt]))
                view = View(drawn.camera, settings.width, settings.height)
                try:
                    image = renderer.full(drawn.scene, view)
                    break
                except RenderingError:
                    # A camera that sees nothing but sky or a wall; the next attempt draws another scene.
                    if attempt == _TRIES - 1:
                        raise
            truth = truth_pass.truth(drawn.scene, view)
            yield TrainingFrame(develop(image.pixels, drawn.sensor), to_train_ids(truth.class_map), seed)
    finally:
        truth_pass.close()
        renderer.close()


def _numeric_class() -> str:
    from valerie.rendering.raster.context import process_context

    return process_context().numeric_class


def _provenance(settings: FrameSettings, seeds: range, numeric_class: str) -> dict[str, str]:
    from valerie.rendering import ground_truth
    from valerie.rendering.raster.renderer import RasterRenderer

    _, first_digest = asset_manifest({"name": settings.asset, "seed": seeds[0]})
    return {
        "asset": settings.asset,
        "asset-digest-of-first-street": first_digest,
        "frame-revisions": (
            f"scenes {training_scenes.REVISION}, sensor {sensor.REVISION}, "
            f"raster {RasterRenderer.revision}, truth {ground_truth.REVISION}"
        ),
        "frame-size": f"{settings.width}x{settings.height}",
        "frames-per-street": str(settings.per_street),
        "renderer": f"raster, {numeric_class}",
        "split": settings.split,
        "street-seeds": f"{seeds[0]}-{seeds[-1]}",
    }
