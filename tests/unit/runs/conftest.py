"""A manifest like the built-in street's, and pins as workers offer them; property tests here measure no times."""

from typing import Any

import pytest
from hypothesis import settings

from valerie.perception.base import FunctionCard
from valerie.runs.products.pins import FunctionPin, Offer, Pins
from valerie.runs.products.states import Stage
from valerie.scene.assets.manifest import Manifest, parse_manifest

settings.register_profile("no deadline", deadline=None)
settings.load_profile("no deadline")


def number(path: str, low: float, high: float, default: float, affects: str, unit: str = "") -> dict[str, Any]:
    return {
        "path": path, "type": "FLOAT", "minimum": low, "maximum": high, "default": default, "affects": affects,
        "unit": unit,
    }  # fmt: skip


def angle(path: str, default: float, affects: str, low: float = 0.0, high: float = 360.0) -> dict[str, Any]:
    return {**number(path, low, high, default, affects, "deg"), "type": "ANGLE"}


def parameters() -> list[dict[str, Any]]:
    documents: list[dict[str, Any]] = []
    for person, default in (("person-1", "yellow-shirt"), ("person-2", "absent")):
        documents += [
            number(f"scene.{person}.pos.x", -10, 20, 3, "geometry", "m"),
            number(f"scene.{person}.pos.y", 0, 100, 20, "geometry", "m"),
            angle(f"scene.{person}.heading", 180, "geometry"),
            {
                "path": f"scene.{person}.character", "type": "CATEGORICAL", "default": default, "affects": "geometry",
                "choices": ["black-outfit", "yellow-shirt", "absent"],
            },
            number(f"scene.{person}.cloth.metallic", 0, 1, 0, "material"),
        ]  # fmt: skip
    documents += [
        angle("scene.sun-1.azimuth", 200, "light"),
        number("scene.sun-1.elevation", 3, 75, 40, "light", "deg"),
    ]
    for camera in ("camera-1", "camera-2", "camera-3"):
        documents += [
            number(f"scene.{camera}.pos.x", -5, 10, 2, "geometry", "m"),
            angle(f"scene.{camera}.yaw", 0, "geometry", -180, 180),
            number(f"scene.{camera}.focal_length_mm", 10, 200, 50, "geometry", "mm"),
        ]
    documents += [
        number("sensor.exposure_ev", -4, 4, 0, "sensor-radiometry", "EV"),
        number("sensor.gamma", 0.5, 3, 1, "sensor-radiometry"),
    ]
    return documents


@pytest.fixture(scope="session")
def street() -> Manifest:
    return parse_manifest(
        {
            "name": "urban-street",
            "extent": [-10, 0, 20, 100],
            "parameters": parameters(),
            "movable": ["scene.person-1", "scene.person-2"],
            "persons": ["scene.person-1", "scene.person-2"],
            "cameras": ["camera-1", "camera-2", "camera-3"],
            "obstacles": [{"path": "scene.building-3", "polygon": [[-10, 40], [0, 40], [0, 60], [-10, 60]]}],
        }
    )


@pytest.fixture
def pins() -> Pins:
    def rendering(name: str) -> Offer:
        return Offer(stage=Stage.RENDER, name=name, numeric_class="llvmpipe-mesa-22", revision=1, route="render.a")

    def function(name: str, digest: str) -> FunctionPin:
        return FunctionPin(
            stage=Stage.INFER, name=name, numeric_class="torch-cpu-fp32", revision=1, route="infer.a", digest=digest,
            card=FunctionCard(name, digest, name, "fp32", "torch", {}),
        )  # fmt: skip

    names = {"deeplabv3plus-small": "a" * 64, "semantic-fpn-small": "b" * 64}
    functions = {name: function(name, digest) for name, digest in names.items()}
    return Pins(engine=rendering("raster"), truth=rendering("truth"), functions=functions)
