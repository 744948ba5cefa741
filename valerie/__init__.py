"""Validation of perception DNNs of automated vehicles by systematic variation of synthetic scenes.

>>> workbench = valerie.connect("var/valerie")
>>> run = workbench.submit("examples/first-run.yaml").wait(progress=True)
>>> run.rows("distance_m > 25 and pacc < 0.5").to_pandas()
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from valerie.workbench.asynchronous import AsyncWorkbench
    from valerie.workbench.workbench import Workbench

__all__ = ["connect", "connect_async"]


def connect(place: str | Path | None = None, *, token: str | None = None) -> Workbench:
    """Open the runs of a server or of a data folder.

    Args:
        place: address of a server, or a data folder; by default the folder that the commands use. Where a server works on the
            folder, the server answers.
        token: bearer token of a server; by default that of the settings.

    Raises:
        NotFound: the folder has no runs.
        ValerieError: the database is of another version.
    """
    from valerie.workbench.source_choice import open_source
    from valerie.workbench.workbench import Workbench

    return Workbench(open_source(place, token))


async def connect_async(place: str | Path | None = None, *, token: str | None = None) -> AsyncWorkbench:
    """Open the same for ``await``."""
    import asyncio

    from valerie.workbench.asynchronous import AsyncWorkbench

    return AsyncWorkbench(await asyncio.to_thread(connect, place, token=token))
