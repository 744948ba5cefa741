"""Frames to train on: sites whose seeds no run uses by default, random scenes, exact labels.

Training sites have seeds from 1000 on, held-out ones 900 to 999. Seed 0, the default of every run, is in neither.
"""

from __future__ import annotations

import ctypes
import json
import math
import multiprocessing
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from itertools import count, islice
from pathlib import Path
from typing import Annotated, Final, NamedTuple

import numpy as np
from pydantic import Field

from valerie.analysis.findings.region import Region
from valerie.document import Document
from valerie.errors import InvalidInput, RenderingError
from valerie.labels import to_train_ids
from valerie.parent import end_with_parent
from valerie.perception.documents.training_data import SITE_SEEDS
from valerie.perception.training.frame_folder import (
    SEEDS,
    FrameFolder,
    Shard,
    Split,
    TrainingFrame,
    write_index,
    write_shard,
)
from valerie.pipeline.retraining import training_scenes
from valerie.pipeline.retraining.crowds import crowd_asset
from valerie.pipeline.retraining.training_scenes import AS_MADE, TrainingScene, draw_arguments, draw_scene
from valerie.pipeline.retraining.weak_scenes import TargetRegion
from valerie.plugins import create_renderer, create_truth_pass
from valerie.rendering.base import GroundTruth, LinearImage, Renderer, View
from valerie.rendering.truth import TruthMaker
from valerie.scene.assets.asset import AssetArguments, SceneAsset, asset_manifest, default_pack, load_asset
from valerie.sensing import sensor
from valerie.sensing.sensor import Shot, develop

#: Engine of the pictures.
_ENGINE: Final = "raster"
#: Frames of a site that share camera, light and weather, and so their background.
_TAKES: Final = 2
_TRIES: Final = 10


class FrameSettings(Document):
    """Number, size and content of frames to render.

    Attributes:
        split: ``train`` or ``held-out``; determines the seeds.
        sites: number of sites.
        per_site: number of frames of each site.
        width, height: size in pixels.
        asset: a generated asset that takes a ``seed``.
        arguments: arguments of the generator; all others but the seed are drawn (`training_scenes.draw_arguments`).
        first_seed: first site seed; None: that of the split.
        region: None, or the bounds that must hold for at least one person of a frame
            (`valerie.pipeline.retraining.weak_scenes`). Scenes are drawn until they do.
        broad_share: share of the frames that need not be in the region.
    """

    split: Split = "train"
    sites: Annotated[int, Field(ge=1)] = 100
    per_site: Annotated[int, Field(ge=1, le=10_000)] = 30
    width: Annotated[int, Field(ge=32, le=8192)] = 960
    height: Annotated[int, Field(ge=32, le=8192)] = 540
    asset: str = Field(default_factory=default_pack)
    arguments: AssetArguments = Field(default={})
    first_seed: Annotated[int, Field(ge=0)] | None = None
    region: Region | None = None
    broad_share: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0

    def is_targeted(self, number: int) -> bool:
        """Return True if frame ``number`` of a site must be in the region; broad frames are spread evenly."""
        if self.region is None:
            return False
        return math.floor((number + 1) * self.broad_share) == math.floor(number * self.broad_share)

    def site(self, seed: int) -> AssetArguments:
        """Return the asset of one site, for `load_asset`."""
        return {"name": self.asset, **draw_arguments(self.asset, seed), **self.arguments, "seed": seed}

    def seeds(self) -> range:
        """Return the site seeds, ascending.

        Raises:
            InvalidInput: the split has fewer.
        """
        seeds = SEEDS[self.split]
        if self.first_seed is not None:
            if self.first_seed not in seeds:
                limit = f"{seeds[0]}…{seeds[-1]}"
                raise InvalidInput(f"no seed of {self.split}", field="first_seed", value=self.first_seed, limit=limit)
            seeds = seeds[seeds.index(self.first_seed) :]
        if self.sites > len(seeds):
            raise InvalidInput("more sites than seeds", field="sites", value=self.sites, limit=len(seeds))
        return seeds[: self.sites]


def render_training_frames(
    folder: Path,
    settings: FrameSettings,
    *,
    processes: int = 1,
    progress: Callable[[Shard], None] = lambda _: None,
) -> FrameFolder:
    """Render all sites into a folder; frames depend only on settings, seed and number, not on processes.

    Args:
        folder: folder to write; created if missing; must be empty.
        settings: settings of the frames.
        processes: number of processes; each has its own GL context.
        progress: called after every site.

    Raises:
        InvalidInput: the folder is not empty, or the settings cannot be met.
        RenderingError, MissingDependency: from the raster engine.
    """
    seeds = settings.seeds()
    folder.mkdir(parents=True, exist_ok=True)
    if any(folder.iterdir()):
        raise InvalidInput("the folder is not empty", field="folder", value=str(folder))
    shards: list[Shard] = []
    # Fresh processes, since a GL context does not survive a fork.
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(max(1, processes), mp_context=spawn, initializer=end_with_parent) as pool:
        waiting = [pool.submit(render_site, folder, seed, settings) for seed in seeds]
        try:
            for future in as_completed(waiting):
                shards.append(future.result())
                progress(shards[-1])
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
        makers = pool.submit(_makers).result()
    write_index(folder, shards, _provenance(settings, seeds, makers, shards))
    return FrameFolder(folder)


def render_site(folder: Path, seed: int, settings: FrameSettings) -> Shard:
    """Render the frames of one site in this process, and write its shard."""
    asset = load_asset(settings.site(seed))
    draws = SceneCount()
    shard = write_shard(folder, seed, frames_of(asset, seed, settings, draws))
    _give_back()
    return shard if settings.region is None else shard.model_copy(update={"drawn": draws.count})


def _give_back() -> None:
    """Return freed memory to the system.

    The arrays of sites differ in size, so glibc would keep free memory between them: 6 GB after seven sites in full HD.
    """
    with suppress(AttributeError, OSError):  # another C library
        ctypes.CDLL(None).malloc_trim(0)


@dataclass(slots=True)
class SceneCount:
    """Number of scenes drawn so far."""

    count: int = 0


def frames_of(
    asset: SceneAsset,
    seed: int,
    settings: FrameSettings,
    draws: SceneCount | None = None,
    *,
    most_draws: int = 5_000,
) -> Iterator[TrainingFrame]:
    """Render the frames of one site, one after the other, in this process's GL context.

    Args:
        asset: the site.
        seed: seed of the site and of all draws.
        settings: number and size of frames.
        draws: counts the scenes.
        most_draws: largest number of scenes drawn for a frame in the region; a typical draw costs 6 ms of CPU time.

    Raises:
        RenderingError: no usable image after several draws.
        InvalidInput: too few drawn scenes are in the region.
    """
    crowd = crowd_asset(asset)
    draws = draws if draws is not None else SceneCount()
    with _engines() as (renderer, truth_pass):
        for number in range(settings.per_site):
            target = (
                TargetRegion(settings.region) if settings.region is not None and settings.is_targeted(number) else None
            )
            as_made = AS_MADE if target is None else target.as_made
            most = _TRIES if target is None else most_draws
            scenes = islice(_drawn(crowd, seed, number, as_made, draws), most)
            usable = _first_usable(scenes, target, (settings.width, settings.height), renderer, truth_pass)
            if usable is None:
                raise InvalidInput(
                    f"no drawn scene of site {seed} is in the region", field="region",
                    value=str(settings.region), limit=f"one of {most_draws:,} draws",
                )  # fmt: skip
            scene, view, truth, background = usable
            image = renderer.layer(scene.scene, view).over(background)
            picture = develop(image.pixels, scene.sensor, Shot(run_seed=seed, content=(str(number),)))
            yield TrainingFrame(picture, to_train_ids(truth.class_map), seed)


@contextmanager
def _engines() -> Iterator[tuple[Renderer, TruthMaker]]:
    """Open the engine and the truth pass of training frames."""
    with (
        closing(create_renderer(_ENGINE)) as renderer,
        closing(create_truth_pass(renderer.numeric_class)) as truth_pass,
    ):
        yield renderer, truth_pass


def _drawn(crowd: SceneAsset, seed: int, number: int, as_made: float, draws: SceneCount) -> Iterator[TrainingScene]:
    """Yield scenes for frame ``number`` of a site, without end."""
    for attempt in count():
        rng = np.random.default_rng([training_scenes.REVISION, seed, number, attempt])
        setting = np.random.default_rng([training_scenes.REVISION, seed, number // _TAKES, attempt, 1])
        draws.count += 1
        yield draw_scene(crowd, rng, setting=setting, as_made=as_made)


class _Usable(NamedTuple):
    """A drawn scene that the engine can render, with its truth and its background."""

    scene: TrainingScene
    view: View
    truth: GroundTruth
    background: LinearImage


def _first_usable(
    scenes: Iterable[TrainingScene],
    target: TargetRegion | None,
    size: tuple[int, int],
    renderer: Renderer,
    truth_pass: TruthMaker,
) -> _Usable | None:
    """Return the first scene in the region that the engine can render; None without any.

    Raises:
        RenderingError: the engine refused `_TRIES` scenes.
    """
    unusable = 0
    for scene in scenes:
        view = View(scene.camera, *size)
        if target is not None and not target.possible(scene):
            continue
        truth = truth_pass.truth(scene.scene, view)
        if target is not None and not target.hit(scene, truth, view):
            continue
        try:
            return _Usable(scene, view, truth, renderer.background(scene.scene, view))
        except RenderingError:  # the camera sees only sky or a wall
            unusable += 1
            if unusable == _TRIES:
                raise
    return None


def _makers() -> dict[str, str]:
    """Return the entries of the provenance on engine and truth pass, which are opened in this process."""
    with _engines() as (renderer, truth_pass):
        return {
            "frame-revisions": (
                f"scenes {training_scenes.REVISION}, sensor {sensor.REVISION}, "
                f"{_ENGINE} {renderer.revision}, truth {truth_pass.revision}"
            ),
            "renderer": f"{_ENGINE}, {renderer.numeric_class}",
        }


def _provenance(
    settings: FrameSettings, seeds: range, makers: Mapping[str, str], shards: list[Shard]
) -> dict[str, str]:
    _, first_digest = asset_manifest(settings.site(seeds[0]))
    more: dict[str, str] = {}
    if settings.arguments:
        more["asset-arguments"] = json.dumps(settings.arguments, sort_keys=True)
    if settings.region is not None:
        more["region"] = settings.region.model_dump_json()
        more["broad-share"] = f"{settings.broad_share:g}"
        more["scenes-drawn"] = str(sum(shard.drawn or 0 for shard in shards))
    return {
        **more,
        **makers,
        "asset": settings.asset,
        "asset-digest-of-first-site": first_digest,
        "frame-size": f"{settings.width}x{settings.height}",
        "frames-per-site": str(settings.per_site),
        "split": settings.split,
        SITE_SEEDS: f"{seeds[0]}-{seeds[-1]}",
    }
