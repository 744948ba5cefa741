"""A real Blender that is killed or stopped while it renders: the error is transient, and the next image is right."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import suppress

import numpy as np
import psutil
import pytest

from valerie.errors import RenderingError, TransientError
from valerie.parent import Wire
from valerie.rendering.base import View
from valerie.rendering.cycles.blender import BlenderHolder
from valerie.rendering.cycles.renderer import CyclesRenderer
from valerie.rendering.cycles.settings import CyclesSettings
from valerie.settings import Settings
from valerie.testing.assets import simple_asset

SCENE = simple_asset().base
VIEW = View("camera-1", 96, 54)


@pytest.fixture
def own(deployment: Settings, request: pytest.FixtureRequest) -> Iterator[BlenderHolder]:
    # Patience on a machine that does other things too.
    silence = getattr(request, "param", 120.0)
    blenders = BlenderHolder(deployment.model_copy(update={"cycles_silence_seconds": silence}))
    yield blenders
    blenders.close()


def endless(holder: BlenderHolder) -> CyclesRenderer:
    """Return an engine that renders for minutes, with signs of life."""
    return CyclesRenderer(CyclesSettings(samples=65_536, denoise=False), holder)


def in_the_middle(holder: BlenderHolder, what: signal.Signals) -> int:
    """Send Blender a signal after a second of rendering, and return its process id."""
    pid = holder.get().pid
    start = psutil.Process(pid).cpu_times().user

    def send() -> None:
        with suppress(psutil.NoSuchProcess, ProcessLookupError):  # it ended by itself
            while psutil.Process(pid).cpu_times().user < start + 1.0:
                time.sleep(0.05)
            os.kill(pid, what)

    threading.Thread(target=send, daemon=True).start()
    return pid


def test_a_killed_blender_is_a_transient_error_and_the_next_image_is_right(own: BlenderHolder) -> None:
    quick = CyclesRenderer(CyclesSettings(samples=1, denoise=False), own)
    before = quick.background(SCENE, VIEW).pixels
    pid = in_the_middle(own, signal.SIGKILL)
    with pytest.raises(TransientError, match="ended in the middle of its work"):
        endless(own).background(SCENE, VIEW)
    np.testing.assert_array_equal(quick.background(SCENE, VIEW).pixels, before)
    assert own.get().pid != pid


@pytest.mark.parametrize("own", [10.0], indirect=True)
def test_a_stopped_blender_counts_as_hung_and_is_ended(own: BlenderHolder) -> None:
    pid = in_the_middle(own, signal.SIGSTOP)
    with pytest.raises(TransientError, match="no sign of life for 10 s"):
        endless(own).background(SCENE, VIEW)
    assert not psutil.pid_exists(pid)


def test_blender_gives_signs_of_life_while_it_renders_for_long(
    own: BlenderHolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    pid, receive, signs = own.get().pid, Wire.receive, []

    def counting(wire: Wire, size: int) -> bytes:
        received = receive(wire, size)
        if b'"alive"' in received:
            signs.append(received)
            if len(signs) == 2:
                os.kill(pid, signal.SIGKILL)
        return received

    monkeypatch.setattr(Wire, "receive", counting)
    with pytest.raises(TransientError, match="ended in the middle"):
        endless(own).background(SCENE, VIEW)
    assert len(signs) >= 2  # the one that ends Blender, above


def test_a_request_that_cycles_refuses_is_a_permanent_error_and_blender_goes_on(own: BlenderHolder) -> None:
    pid = own.get().pid
    with pytest.raises(RenderingError, match="KeyError"):
        own.get().ask("forget", meshes=["mesh-nowhere"], materials=[], textures=[])
    CyclesRenderer(CyclesSettings(samples=1, denoise=False), own).background(SCENE, VIEW)
    assert own.get().pid == pid
