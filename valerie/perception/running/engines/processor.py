"""What of a processor may change the last bits of a result: the instructions that kernels are chosen by."""

from __future__ import annotations

import platform
from functools import lru_cache
from pathlib import Path
from typing import Final

#: The newest that a processor has decides; (name, flag as Linux lists it).
_NEWEST_FIRST: Final = (
    ("amx", "amx_bf16"),
    ("avx512-bf16", "avx512_bf16"),
    ("avx512-vnni", "avx512_vnni"),
    ("avx512", "avx512f"),
    ("avx2", "avx2"),
    ("sve", "sve"),
    ("neon", "asimd"),
)


@lru_cache(maxsize=1)
def instruction_set() -> str:
    """E.g. ``amx`` or ``avx512-bf16``; the machine's name where nothing better is known."""
    return newest(flags()) or platform.machine().lower().replace("_", "-")


def flags() -> frozenset[str]:
    """The flags of the first processor, as Linux lists them; empty elsewhere."""
    try:
        lines = Path("/proc/cpuinfo").read_text("utf-8", "replace").splitlines()
    except OSError:
        return frozenset()
    listed = (line.partition(":")[2] for line in lines if line.partition(":")[0].strip() in ("flags", "Features"))
    return frozenset(next(listed, "").split())


def newest(found: frozenset[str]) -> str:
    """The name of the newest instruction set among flags; empty when none is known."""
    return next((name for name, flag in _NEWEST_FIRST if flag in found), "")
