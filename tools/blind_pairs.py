"""Render pairs of pictures, one by `raster` and one by Cycles, for a judge who is not told which is which.

``python -m tools.blind_pairs FOLDER [--seed S --pairs N --samples K]`` draws scenes of the gallery and of the places, and the
side of each engine. It writes ``FOLDER/01-left.png``, ``FOLDER/01-right.png`` and so on, and the sides of Cycles to
``FOLDER.key.json``.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from pathlib import Path
from random import Random
from typing import Any, Final

from PIL import Image

from tools.gallery import CONDITIONS, Condition, picture, street
from tools.place_sheet import PLACES
from valerie import plugins
from valerie.scene.assets.asset import SceneAsset, load_asset

SIZE: Final = (960, 540)
SIDES: Final = ("left", "right")


def scenes() -> Iterator[tuple[SceneAsset, Condition]]:
    """Yield every scene of the gallery and of the places."""
    for condition in CONDITIONS:
        yield street(condition.season), condition
    for name, conditions in PLACES.items():
        asset = load_asset(name)
        yield from ((asset, condition) for condition in conditions)


def main() -> None:
    """Write the pictures and the key."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--pairs", type=int, default=20)
    parser.add_argument("--samples", type=int, default=128, help="samples of Cycles, denoised")
    arguments = parser.parse_args()
    engines: dict[str, dict[str, Any]] = {"raster": {}, "cycles": {"samples": arguments.samples, "denoise": True}}
    random = Random(arguments.seed)  # noqa: S311  draws scenes
    drawn = random.sample(list(scenes()), arguments.pairs)
    of_cycles = [random.choice(SIDES) for _ in drawn]
    arguments.folder.mkdir(parents=True, exist_ok=True)
    for name, settings in engines.items():
        engine = plugins.create_renderer(name, settings)
        try:
            for number, ((asset, condition), side) in enumerate(zip(drawn, of_cycles, strict=True), 1):
                chosen = side if name == "cycles" else SIDES[1 - SIDES.index(side)]
                image = Image.fromarray(picture(engine, asset, condition, SIZE))
                image.save(arguments.folder / f"{number:02}-{chosen}.png")
        finally:
            engine.close()
    captions = [f"{asset.name}: {condition.caption}" for asset, condition in drawn]
    key = [{"scene": caption, "cycles": side} for caption, side in zip(captions, of_cycles, strict=True)]
    arguments.folder.with_name(f"{arguments.folder.name}.key.json").write_text(json.dumps(key, indent=1))


if __name__ == "__main__":
    main()
