"""The street of boxes (`valerie.testing.assets`) as an asset folder of a user, and runs over it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from valerie.scene.assets.manifest import Footprint, Manifest
from valerie.scene.gltf.writer import save_gltf
from valerie.testing.assets import simple_asset, simple_manifest

#: Default place of the car, metres.
CAR_PLACE = (2.0, 8.0)


def write_box_street(folder: Path, **changes: Any) -> None:
    """Write the asset of boxes into an asset folder that does not exist yet.

    Args:
        folder: its name is the asset's.
        changes: other entries of the manifest.
    """
    folder.mkdir(parents=True)
    asset = simple_asset()
    save_gltf(asset.base, folder / "scene.glb")
    document = asset.manifest.model_dump(mode="json") | {"name": folder.name, "files": ["scene.glb"]} | changes
    (folder / "manifest.yaml").write_text(yaml.safe_dump(document))


def pose(path: str, x: float, y: float) -> list[dict[str, object]]:
    """Return the declarations of place and heading of a node, with the default place (x, y)."""
    return [
        {"path": f"{path}.pos.x", "minimum": -40, "maximum": 40, "default": x},
        {"path": f"{path}.pos.y", "minimum": -40, "maximum": 80, "default": y},
        {"path": f"{path}.heading", "default": 0},
    ]


def traffic(*obstacles: Footprint, **fields: object) -> Manifest:
    """Return the manifest of boxes with a car that moves and a hidden bicycle at (0, 30) that moves too.

    Args:
        obstacles: further obstacles.
        fields: other entries of the manifest.
    """
    document = simple_manifest().model_dump(mode="json")
    bicycle = Footprint(path="scene.bicycle-1", polygon=((-0.3, 29), (0.3, 29), (0.3, 31), (-0.3, 31)))
    document["obstacles"] += [obstacle.model_dump() for obstacle in (*obstacles, bicycle)]
    document["parameters"] = [
        *document["parameters"],
        *pose("scene.car-1", *CAR_PLACE),
        *pose("scene.bicycle-1", 0, 30),
        {"path": "scene.bicycle-1.visible", "default": False},
    ]
    return Manifest.model_validate({**document, **fields})


def spec(*, xs: int = 20, ys: int = 20, name: str = "boxes", **more: Any) -> dict[str, Any]:
    """Return the spec of a run over xs × ys places, two cameras, with the blank engine and function.

    Backgrounds are not inferred: the numbers of products that tests count do not hang on how many share one. The exposure
    is fixed: the blank function finds persons by their grey level.
    """
    return {
        "name": name,
        "asset": "box-street",
        "vary": [
            ["person-1.pos.x", "HOMOGENEOUS", -3.0, -3.0 + 0.1 * (xs - 1), 0.1],
            ["person-1.pos.y", "HOMOGENEOUS", 3.0, 3.0 + 0.2 * (ys - 1), 0.2],
        ],
        "renderer": "blank",
        "functions": ["blank"],
        "resolution": {"width": 64, "height": 36},
        "infer_backgrounds": False,
        "sensors": [{"auto_exposure": False}],
        **more,
    }
