"""The device of Cycles, with a Blender that has a graphics card."""

from pathlib import Path
from types import SimpleNamespace
from unittest.mock import MagicMock

import pytest

from valerie.rendering.cycles.inside.studio import Studio
from valerie.rendering.surface_constants import CONSTANTS, relief_corners


class Preferences:
    """Cycles' preferences as Blender starts with them: no device is chosen."""

    def __init__(self) -> None:
        self.compute_device_type = "NONE"
        self.devices = [SimpleNamespace(type=kind, name=kind.title(), use=False) for kind in ("CPU", "CUDA", "OPTIX")]

    def get_device_types(self, _: object) -> list[tuple[str]]:
        return [("NONE",), ("CUDA",), ("OPTIX",)]

    def get_devices_for_type(self, kind: str) -> list[SimpleNamespace]:
        return [device for device in self.devices if device.type in (kind, "CPU")]


@pytest.fixture
def blender() -> MagicMock:
    bpy = MagicMock()

    def read_factory_settings(**_: object) -> None:
        bpy.context.preferences.addons = {"cycles": SimpleNamespace(preferences=Preferences())}

    bpy.ops.wm.read_factory_settings.side_effect = read_factory_settings
    return bpy


@pytest.mark.parametrize(
    ("choice", "kind"), [("auto", "OPTIX"), ("cuda", "CUDA"), ("optix", "OPTIX"), ("hip", "CPU"), ("cpu", "CPU")]
)
def test_the_chosen_device_renders_also_after_a_reset(
    choice: str, kind: str, blender: MagicMock, tmp_path: Path
) -> None:
    studio = Studio(blender, str(tmp_path), MagicMock())
    answer, _ = studio.hello(
        {"device": choice, "threads": 1, "constants": dict(CONSTANTS)}, {"reliefs": relief_corners()}
    )
    assert answer["device"] == kind
    studio.reset({}, {})
    preferences = blender.context.preferences.addons["cycles"].preferences
    on_card = kind != "CPU"
    assert preferences.compute_device_type == (kind if on_card else "NONE")
    assert [device.type for device in preferences.devices if device.use] == ([kind] if on_card else [])
    assert blender.context.scene.cycles.device == ("GPU" if on_card else "CPU")
