"""The street of boxes (`valerie.testing.assets`) as an asset folder of a user, and runs over it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from valerie.scene.gltf.writer import save_gltf
from valerie.testing.assets import simple_asset


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


def spec(*, xs: int = 20, ys: int = 20, name: str = "boxes", **more: Any) -> dict[str, Any]:
    """Return the spec of a run over xs × ys places, two cameras, with the blank engine and function.

    Backgrounds are not inferred: the numbers of products that tests count do not hang on how many share one.
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
        **more,
    }
