from __future__ import annotations

import pytest

pytest.importorskip("torch")

from tests.world.training import box_frames


@pytest.fixture
def make_frames():
    """``make_frames(n, site_seed=1000, height=64, width=96)``: a list of synthetic frames."""
    return box_frames
