"""The software of this process: VALERIE, Python and all installed packages."""

from __future__ import annotations

import platform
from functools import cache
from importlib.metadata import PackageNotFoundError, distributions, version

from valerie.plain import JsonObject
from valerie.spelling import package_name


def software() -> str:
    """Return the name and version of this program."""
    try:
        return f"valerie {version('valerie')}"
    except PackageNotFoundError:
        return "valerie (not installed)"


def environment() -> JsonObject:
    """Return the versions of this program, Python and all installed packages, and the kind of machine, as JSON values."""
    return {
        "software": software(),
        "python": f"{platform.python_implementation()} {platform.python_version()}",
        "system": platform.system(),
        "machine": platform.machine(),
        "packages": dict(_packages()),
    }


@cache
def _packages() -> tuple[tuple[str, str], ...]:
    return tuple(sorted((package_name(package.name), package.version) for package in distributions()))
