"""The Blender process and its messages, with a fake Blender that crashes, hangs or runs out of memory."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable
from pathlib import Path

import numpy as np
import psutil
import pytest

from valerie.errors import MissingDependency, RenderingError, TransientError
from valerie.rendering.base import View
from valerie.rendering.cycles.blender import BlenderHolder, BlenderProcess, interpreter
from valerie.rendering.cycles.renderer import CyclesRenderer, numeric_class
from valerie.rendering.cycles.settings import CyclesSettings
from valerie.settings import load_settings
from valerie.testing.assets import simple_manifest, simple_scene

VIEW = View("camera-1", 40, 30)
SCENE = simple_scene(simple_manifest())
Holders = Callable[..., BlenderHolder]


def engine(holder: BlenderHolder) -> CyclesRenderer:
    return CyclesRenderer(CyclesSettings(samples=1), holder)


def test_pixels_arrive_as_they_were_sent(holder: Holders) -> None:
    pixels = engine(holder("works")).background(SCENE, VIEW).pixels
    expected = np.float16(0.1 + 0.8 * np.arange(40) / 40)
    np.testing.assert_array_equal(pixels[7, :, 1], expected)


def test_cpu_seconds_are_those_that_all_blender_processes_report(holder: Holders) -> None:
    blenders = holder("works")
    cycles = engine(blenders)
    cycles.background(SCENE, VIEW)
    before = cycles.cpu_seconds_elsewhere
    cycles.background(SCENE, VIEW)
    assert cycles.cpu_seconds_elsewhere == before + 0.25
    blenders.close()
    assert cycles.cpu_seconds_elsewhere == before + 0.25


@pytest.mark.parametrize(
    ("behaviour", "reason"),
    [
        ("crashes", r"ended in the middle of its work \(status -11: Segmentation fault\)"),
        ("hangs", "no sign of life for 1 s"),
        ("has no memory", "out of GPU memory"),
    ],
)
def test_a_temporary_failure_is_a_transient_error_and_leaves_no_process(
    holder: Holders, behaviour: str, reason: str
) -> None:
    blenders = holder(behaviour)
    cycles = engine(blenders)
    pid = blenders.get().pid
    with pytest.raises(TransientError, match=reason):
        cycles.background(SCENE, VIEW)
    assert not psutil.pid_exists(pid)


def test_a_blender_that_outgrows_its_limit_is_ended(holder: Holders) -> None:
    blenders = holder("hangs", cycles_max_memory_mb=1, cycles_silence_seconds=30.0)
    with pytest.raises(TransientError, match="VALERIE_CYCLES_MAX_MEMORY_MB is 1"):
        engine(blenders).background(SCENE, VIEW)


def test_slow_work_with_signs_of_life_is_no_hang(holder: Holders) -> None:
    engine(holder("is slow")).background(SCENE, VIEW)


def test_after_a_crash_everything_is_sent_again_to_a_new_blender(holder: Holders) -> None:
    blenders = holder("crashes once")
    cycles = engine(blenders)
    with pytest.raises(TransientError):
        cycles.background(SCENE, VIEW)
    cycles.background(SCENE, VIEW)
    statics = [mesh for node in SCENE.nodes.values() if not node.movable for mesh in node.meshes]
    assert all(any(value is mesh for value in blenders.get().known.values()) for mesh in statics)


def test_a_request_that_blender_refuses_is_a_permanent_error(holder: Holders) -> None:
    blenders = holder("refuses")
    with pytest.raises(RenderingError, match="no such socket"):
        engine(blenders).background(SCENE, VIEW)
    assert blenders.get().alive


def test_an_interrupted_request_ends_the_process(holder: Holders) -> None:
    blender = holder("hangs").get()
    threading.Timer(0.1, os.kill, (os.getpid(), signal.SIGINT)).start()
    with pytest.raises(KeyboardInterrupt):
        blender.ask("render", size=[4, 4], border=None)
    assert not blender.alive


def test_a_missing_environment_says_how_to_make_it(tmp_path: Path) -> None:
    settings = load_settings({}, cycles_python=tmp_path / "python")
    with pytest.raises(MissingDependency, match="make cycles"):
        interpreter(settings)


def test_a_device_that_is_not_there_is_named(holder: Holders) -> None:
    with pytest.raises(MissingDependency, match="VALERIE_CYCLES_DEVICE is cuda"):
        holder("works", cycles_device="cuda").get()


def test_blender_sees_none_of_our_settings_and_secrets(holder: Holders, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("VALERIE_API_TOKEN", "secret")
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "secret")
    blender = holder("works").get()
    environment = psutil.Process(blender.pid).environ()
    assert not [name for name in environment if name.startswith(("VALERIE_", "AWS_"))]


def test_its_folder_goes_with_it(holder: Holders, tmp_path: Path) -> None:
    blenders = holder("works")
    blenders.get()
    assert list(tmp_path.glob("valerie-cycles-*"))
    blenders.close()
    assert not list(tmp_path.glob("valerie-cycles-*"))


def test_memory_of_what_was_sent_stays_bounded(holder: Holders) -> None:
    blenders = holder("works")
    cycles = engine(blenders)
    cycles.background(SCENE, VIEW)
    used = len(blenders.get().known)
    for i in range(60):
        cycles.background(simple_scene(simple_manifest()), View("camera-1", 8 + i, 4))
    # As many as two images use, and 64 to spare.
    assert len(blenders.get().known) <= 2 * used + 64


@pytest.mark.parametrize(
    ("device", "name", "expected"),
    [
        ("OPTIX", "NVIDIA H100 80GB HBM3", "bpy-4.5.15-optix-nvidia-h100-80gb-hbm3"),
        ("HIP", "AMD Radeon PRO W7900", "bpy-4.5.15-hip-amd-radeon-pro-w7900"),
    ],
)
def test_the_numeric_class_names_version_and_device(device: str, name: str, expected: str) -> None:
    assert numeric_class("4.5.15 LTS", device, name) == expected


def test_a_processor_is_known_by_its_instruction_set() -> None:
    assert numeric_class("4.5.15 LTS", "CPU", "").startswith("bpy-4.5.15-cpu-")


def test_one_blender_serves_the_whole_process(holder: Holders) -> None:
    blenders = holder("works")
    first, second = (
        CyclesRenderer(CyclesSettings(samples=1), blenders),
        CyclesRenderer(CyclesSettings(samples=2), blenders),
    )
    pid = blenders.get().pid
    first.background(SCENE, VIEW)
    first.close()
    second.background(SCENE, VIEW)
    assert blenders.get().pid == pid != os.getpid()
    assert isinstance(blenders.get(), BlenderProcess)
