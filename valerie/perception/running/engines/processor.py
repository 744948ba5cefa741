"""The instruction set of the processor. Libraries choose kernels by it, so it may change the last bits of a result."""

from __future__ import annotations

import platform
from functools import lru_cache
from pathlib import Path
from typing import Final

#: Name and Linux flag of each instruction set; the newest of a processor counts.
_NEWEST_FIRST: Final = (
    ("amx", "amx_bf16"),
    ("avx512-bf16", "avx512_bf16"),
    ("avx512-vnni", "avx512_vnni"),
    ("avx512", "avx512f"),
    ("avx-vnni", "avx_vnni"),
    ("avx2", "avx2"),
    ("sve", "sve"),
    ("neon", "asimd"),
)

_BF16_FLAGS: Final = ("amx_bf16", "avx512_bf16")


@lru_cache(maxsize=1)
def instruction_set() -> str:
    """Return e.g. ``amx`` or ``avx512-bf16``; the name of the architecture if no instruction set is known."""
    return newest(flags()) or platform.machine().lower().replace("_", "-")


def multiplies_bf16() -> bool:
    """Return True if the processor has instructions for bf16, which make it faster than fp32."""
    return not flags().isdisjoint(_BF16_FLAGS)


def flags() -> frozenset[str]:
    """Return the flags of the first processor that Linux lists; empty on other systems."""
    try:
        lines = Path("/proc/cpuinfo").read_text("utf-8", "replace").splitlines()
    except OSError:
        return frozenset()
    entries = (line.partition(":")[2] for line in lines if line.partition(":")[0].strip() in ("flags", "Features"))
    return frozenset(next(entries, "").split())


def newest(names: frozenset[str]) -> str:
    """Return the name of the newest instruction set among flags; empty if none is known."""
    return next((name for name, flag in _NEWEST_FIRST if flag in names), "")
