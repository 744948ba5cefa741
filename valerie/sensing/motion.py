"""What moves while the shutter is open, and while the rows are read one after another.

Both work on optical flow: how far, in pixels, what is seen at a pixel moves across the image from one frame to the next.
Sources: M. Potmesil and I. Chakravarty, "Modeling motion blur in computer-generated images", SIGGRAPH 1983,
doi:10.1145/800059.801169; C.-K. Liang et al., "Analysis and compensation of rolling shutter effect", IEEE TIP 17(8), 2008,
doi:10.1109/TIP.2008.925384.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from valerie.sensing.resampling import bilinear

#: Steps between two looks along the longest track, pixels.
_STRIDE: Final = 1.0
_MOST_LOOKS: Final = 64

Floats = NDArray[np.float32]


def motion_blur(linear: Floats, flow: Floats, shutter: float) -> Floats:
    """The mean of what passes each pixel while the shutter is open, centred on the frame's own time.

    Args:
        linear: (H, W, 3), linear light.
        flow: (H, W, 2) float32, pixels to the right and down per frame interval.
        shutter: open share of the frame interval, 0 to 1 (a shutter angle of 180° is 0.5).

    Returns:
        (H, W, 3); the same array where nothing moves or the shutter is a moment.
    """
    longest = float(np.max(np.hypot(flow[..., 0], flow[..., 1]), initial=0.0)) * shutter
    if longest == 0.0:
        return linear
    looks = min(max(int(np.ceil(longest / _STRIDE)) + 1, 2), _MOST_LOOKS)
    height, width = linear.shape[:2]
    columns, rows = np.arange(width, dtype=np.float64), np.arange(height, dtype=np.float64)[:, None]
    total = np.zeros_like(linear)
    for time in (np.arange(looks) + 0.5) / looks - 0.5:
        moved = flow * np.float32(time * shutter)
        total += bilinear(linear, columns - moved[..., 0], rows - moved[..., 1])
    total /= np.float32(looks)
    return total


def rolling_shutter_map(flow: Floats, readout: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Where the pixels of a picture come from whose rows are read one after another.

    The middle row is read at the frame's own time. As with distortion, the same map belongs to image and truth.

    Args:
        flow: (H, W, 2) as of `motion_blur`.
        readout: share of the frame interval between the first row and the last.

    Returns:
        x, y: (H, W) float64 pixel coordinates in the image.
    """
    height, width = flow.shape[:2]
    time = (((np.arange(height) + 0.5) / height - 0.5) * readout)[:, None]
    x = np.arange(width)[None, :] - flow[..., 0] * time
    y = np.arange(height)[:, None] - flow[..., 1] * time
    return x, y
