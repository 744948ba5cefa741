"""Runs over the street of boxes, whose pictures, truths and predictions are drawn with numpy (`tests.world.street`)."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from tests.plugin_package import write_package
from tests.world.boxes import write_box_street
from tests.world.makers import DrawingMaker
from tests.world.world import World
from valerie.db.claiming import Job
from valerie.errors import RenderingError
from valerie.parameters.declaring import angle, number
from valerie.parameters.definitions import Affects
from valerie.perception.shipped import function_card
from valerie.runs.products.pins import FunctionOffer, Offer
from valerie.runs.products.states import Stage, route_of
from valerie.scene.assets.manifest import Footprint, Manifest
from valerie.settings import Settings
from valerie.testing.assets import simple_manifest

FUNCTIONS = ("deeplabv3plus-small", "semantic-fpn-small")
CLASS = "drawn-1"
#: The asset of the runs, and the choices of a pedestrian in it.
ASSET = "drawn-street"
#: The same as a generated asset, which takes a seed (`installed_town`).
TOWN = "drawn-town"
CHARACTERS = ("red-coat", "blue-coat")
#: Products of one step of a run that stays unfinished.
_FEW = 24


class DrawnWorld(World):
    """A deployment with one worker per stage that offers drawn products, functions as if in ``infer_class``."""

    def __init__(self, settings: Settings, *, infer_class: str = CLASS) -> None:
        if not (settings.asset_dir / ASSET).exists():
            write_drawn_street(settings.asset_dir / ASSET)
        super().__init__(settings, lambda context: dict.fromkeys((Stage.RENDER, Stage.INFER), DrawingMaker(context)))
        render = (
            Offer(
                stage=Stage.RENDER,
                name=name,
                numeric_class=CLASS,
                revision=1,
                route=route_of(Stage.RENDER, name, CLASS),
            )
            for name in ("raster", "truth")
        )
        infer = (
            FunctionOffer(
                stage=Stage.INFER, name=name, numeric_class=infer_class, revision=1,
                route=route_of(Stage.INFER, infer_class), digest=card.digest, card=card,
            )
            for name in FUNCTIONS if (card := function_card(name))
        )  # fmt: skip
        self.offer("drawn-render", *render)
        self.offer("drawn-infer", *infer, stage=Stage.INFER)
        self.offer("drawn-eval", stage=Stage.EVAL)

    def work(
        self, document: dict[str, Any], *, broken: Callable[[Job], bool] = lambda _: False, products: int | None = None
    ) -> str:
        """Submit a run and work it off; return its id.

        Args:
            document: the run's spec.
            broken: which of the rendered products fail for good.
            products: work on so many and leave the run unfinished (default: work it off).
        """

        def fail(job: Job) -> None:
            if broken(job):
                raise RenderingError("drawn: the image is constant (every sampled pixel is 0)")

        run_id = self.submit(document)
        self.makers[Stage.RENDER].before = fail
        if products is None:
            self.run(run_id)
        else:
            while count := self.step(min(_FEW, products)):
                products -= count
        return run_id


def drawn_manifest() -> Manifest:
    """Return the manifest of boxes with a row of houses on the right, and with every parameter that a drawn camera has."""
    manifest = simple_manifest()
    cameras = []
    for name, place, yaw in (("camera-1", (2.5, -12.0, 1.4), 0.0), ("camera-2", (0.6, -12.0, 1.3), 358.0)):
        path = f"scene.{name}"
        cameras += [
            number(f"{path}.pos.{axis}", -20, 20, at, Affects.GEOMETRY, "m")
            for axis, at in zip("xyz", place, strict=True)
        ]
        cameras += [
            angle(f"{path}.yaw", yaw, Affects.GEOMETRY),
            number(f"{path}.focal_length_mm", 20, 100, 50.0, Affects.GEOMETRY, "mm"),
        ]
    own = [
        number(parameter.path, -12, 85, 45.0, parameter.affects, "deg") if "elevation" in parameter.path else parameter
        for parameter in manifest.parameters
        if ".camera-" not in parameter.path
    ]
    houses = Footprint(path="scene.building-1", polygon=((5, -5), (12, -5), (12, 55), (5, 55)))
    return manifest.model_copy(update={"parameters": (*own, *cameras), "obstacles": (houses,)})


def write_drawn_street(folder: Path) -> None:
    document = drawn_manifest().model_dump(mode="json")
    write_box_street(folder, parameters=document["parameters"], obstacles=document["obstacles"])


#: An asset pack whose streets differ by their seed in name only.
_TOWN = """
from pydantic import Field

from tests.world.drawn import TOWN, drawn_manifest
from valerie.scene.assets.asset import PackSettings
from valerie.testing.assets import simple_scene

REVISION = 1


class Settings(PackSettings):
    seed: int = Field(default=0, ge=0)


def make_manifest(settings):
    return drawn_manifest().model_copy(update={"name": TOWN})


def make_scene(settings, manifest):
    return simple_scene(manifest)


def draw_arguments(rng):
    return {}
"""


@contextmanager
def installed_town(folder: Path) -> Iterator[None]:
    """Install the asset pack `TOWN`, and let the operator allow it."""
    points = {"valerie.assets": {TOWN: "drawn_town"}}
    write_package(folder, "drawn-assets", modules={"drawn_town": _TOWN}, entry_points=points)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(folder))
        patch.setenv("VALERIE_PLUGINS", "drawn-assets")
        yield
    sys.modules.pop("drawn_town", None)


def spec(name: str, *, width: int = 96, height: int = 54, **more: Any) -> dict[str, Any]:
    """Return a spec of 24 variants: twelve places, both pedestrians; one x stands inside a house."""
    return {
        "name": name,
        "asset": ASSET,
        "vary": [
            ["person-1.pos.x", "HOMOGENEOUS", -1.0, 6.0, 3.5],
            ["person-1.pos.y", "HOMOGENEOUS", 5.0, 35.0, 10.0],
            ["person-1.character", "CHOICE", list(CHARACTERS)],
        ],
        "resolution": {"width": width, "height": height},
        "functions": list(FUNCTIONS),
        **more,
    }


@dataclass(frozen=True)
class DrawnRuns:
    """A deployment's folder and the runs in it, oldest first.

    Attributes:
        finished: every product is done; some variants are rejected, some persons undefined.
        failed: completed with failures: the layer of variant 4 is broken in each camera.
        running: some products are done.
        waiting: submitted; no worker offers its engine.
    """

    folder: Path
    finished: str
    failed: str
    running: str
    waiting: str


def draw_runs(settings: Settings) -> DrawnRuns:
    """Work off one run for each attribute of `DrawnRuns`, as far as it says."""
    world = DrawnWorld(settings)
    finished = world.work(spec("finished"))
    failed = world.work(spec("failed", constants={"sun-1.elevation": 12}), broken=layer_of_variant_4)
    running = world.work(spec("running", constants={"sun-1.elevation": 25}), products=100)
    waiting = world.work(spec("waiting", renderer="pyrender"), products=0)
    world.context.engine.dispose()
    return DrawnRuns(settings.data_dir, finished, failed, running, waiting)


def layer_of_variant_4(job: Job) -> bool:
    return job.kind == "layer" and job.frame.key.variant == 4
