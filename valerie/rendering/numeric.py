"""Names for the arithmetic of a graphics driver."""

from __future__ import annotations

import re


def numeric_class(renderer: str, version: str) -> str:
    """Return a name for the arithmetic of a driver, in ``[a-z0-9.-]``: the renderer, with its SIMD width, and the driver version.

    ``llvmpipe (LLVM 15.0.6, 256 bits)`` and ``4.5 (Core Profile) Mesa 22.3.6`` give
    ``llvmpipe-llvm-15.0.6-256-bits-mesa-22.3.6``.
    """
    driver = re.sub(r"^[\d.]+\s*(\([^)]*\))?", "", version)
    return re.sub(r"[^a-z0-9.]+", "-", f"{renderer} {driver}".lower()).strip("-")
