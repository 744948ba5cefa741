"""Training scenes of the street."""

from __future__ import annotations

import numpy as np

from valerie.parameters.definitions import Value
from valerie.pipeline.retraining.training_scenes import draw_traffic
from valerie.scene.assets.asset import asset_manifest
from valerie.scene.graph.model import Camera
from valerie.scene.graph.transforms import camera_transform


def test_what_an_asset_leaves_out_of_training_changes_no_draw() -> None:
    manifest, _ = asset_manifest("urban-street")
    camera = Camera("scene.camera-1", camera_transform((2.5, -12.0, 1.4), 0.0, 0.0, 0.0), 50.0, 36.0)
    left_out = manifest.training.left_out
    first = manifest.model_copy(update={"movable": tuple(p for p in manifest.movable if p not in left_out)})
    assert len(first.movable) < len(manifest.movable)
    drawn: list[dict[str, Value]] = []
    for one in (manifest, first):
        rng, assignment = np.random.default_rng(4), dict[str, Value]()
        for _ in range(10):
            draw_traffic(camera, assignment, one, rng)
        drawn.append({**assignment, "next": float(rng.random())})
    assert drawn[0] == drawn[1]
    assert {path.split(".")[1] for path in drawn[0] if path != "next"} == {"car-101", "bicycle-101"}
