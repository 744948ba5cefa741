"""The software of this process: VALERIE, Python and all installed packages."""

from __future__ import annotations

import platform
from functools import cache
from importlib.metadata import PackageNotFoundError, distributions, version

from valerie.document import Document
from valerie.spelling import package_name


def software() -> str:
    """Return the name and version of this program."""
    try:
        return f"valerie {version('valerie')}"
    except PackageNotFoundError:
        return "valerie (not installed)"


class Environment(Document):
    """The software of a process.

    Attributes:
        software: name and version of this program.
        python: implementation and version.
        system, machine: operating system and kind of processor.
        packages: name to version of all installed packages.
    """

    software: str
    python: str
    system: str
    machine: str
    packages: dict[str, str]


def environment() -> Environment:
    """Return the software of this process."""
    return Environment(
        software=software(),
        python=f"{platform.python_implementation()} {platform.python_version()}",
        system=platform.system(),
        machine=platform.machine(),
        packages=dict(_packages()),
    )


@cache
def _packages() -> tuple[tuple[str, str], ...]:
    return tuple(sorted((package_name(package.name), package.version) for package in distributions()))
