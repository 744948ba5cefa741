"""A package with plug-ins as an installer leaves it: modules beside a ``dist-info`` folder, to be put on a path."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import pytest


def write_package(
    folder: Path, name: str, *, modules: Mapping[str, str], entry_points: Mapping[str, Mapping[str, str]]
) -> Path:
    """Write a distribution.

    Args:
        folder: to put on a path; created if missing.
        name: of the distribution.
        modules: dotted name of each module to its source.
        entry_points: group to names to ``module:attribute``.

    Returns:
        ``folder``.
    """
    info = folder / f"{name.replace('-', '_')}-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    sections = (
        f"[{group}]\n" + "".join(f"{point} = {value}\n" for point, value in points.items())
        for group, points in entry_points.items()
    )
    (info / "entry_points.txt").write_text("\n".join(sections))
    for module, source in modules.items():
        path = folder.joinpath(*module.split(".")).with_suffix(".py")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(source)
    return folder


def install_boxes(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Install the distribution ``box-assets`` for one test, and let the operator allow it."""
    write_boxes(folder)
    monkeypatch.syspath_prepend(str(folder))
    monkeypatch.setenv("VALERIE_PLUGINS", "box_assets")
    return folder


#: An asset pack: the boxes of `valerie.testing.assets`, in a street of any bearing.
BOXES = """
from pydantic import Field

from valerie.scene.assets.asset import PackSettings
from valerie.testing.assets import simple_manifest, simple_scene

REVISION = 1


class Settings(PackSettings):
    seed: int = Field(default=0, ge=0)
    bearing_deg: float = Field(default=0.0, ge=0.0, lt=360.0)


def make_manifest(settings):
    return simple_manifest().model_copy(update={"name": "boxes", "bearing_deg": settings.bearing_deg})


def make_scene(settings, manifest):
    return simple_scene(manifest)


def draw_arguments(rng):
    return {"bearing_deg": float(rng.integers(360))}
"""


#: Functions that hang and that ask for too much, each where the picture's first pixel says so; all else is road.
GREEDY = '''
import hashlib
import time

import numpy as np

from valerie.perception.base import FunctionCard


def troubles(picture):
    """Return True if this picture causes trouble; about half of all do."""
    return hashlib.sha256(picture.tobytes()).digest()[0] % 2 == 0


class _Function:
    revision = 1

    def __init__(self):
        name = type(self).__name__.lower()
        self.card = FunctionCard(name, hashlib.sha256(name.encode()).hexdigest(), name, "uint8", "numpy", {})
        self.numeric_class = "numpy-uint8"

    def predict(self, picture):
        if troubles(picture):
            self.trouble()
        return np.zeros(picture.shape[:2], np.uint8)

    def close(self):
        pass


class Sleeper(_Function):
    def trouble(self):
        time.sleep(3600)


class Glutton(_Function):
    def trouble(self):
        np.empty(6 << 30, np.uint8)  # reserved and never touched: harmless where nothing refuses it
'''
_POINTS = {"valerie.functions": {"sleeper": "greedy:Sleeper", "glutton": "greedy:Glutton"}}


def write_greedy(folder: Path) -> Path:
    """Write the distribution ``greedy-functions`` with the functions ``sleeper`` and ``glutton``; return ``folder``."""
    return write_package(folder, "greedy-functions", modules={"greedy": GREEDY}, entry_points=_POINTS)


def write_boxes(folder: Path) -> Path:
    """Write the distribution ``box-assets`` with the asset ``boxes``; return ``folder``."""
    return write_package(
        folder, "box-assets", modules={"boxes": BOXES}, entry_points={"valerie.assets": {"boxes": "boxes"}}
    )
