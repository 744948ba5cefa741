"""The dashboard's files, with a policy that allows only its own scripts, and requests only to this server."""

from __future__ import annotations

from importlib import resources
from os import PathLike
from pathlib import Path
from typing import Any, Final

from starlette.responses import Response
from starlette.staticfiles import StaticFiles
from starlette.types import Scope

POLICY: Final = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
#: Browsers ask for it again whenever the address changes, so at every brush.
_ICON: Final = "icon.svg"


class DashboardFiles(StaticFiles):
    """`StaticFiles` of the package folder ``services/api/dashboard``."""

    def __init__(self) -> None:
        super().__init__(directory=str(resources.files("services.api") / "dashboard"), html=True)

    async def get_response(self, path: str, scope: Scope) -> Response:
        """Add the policy, and make browsers revalidate, so that a new version shows at the next reload."""
        response = await super().get_response(path, scope)
        return _guarded(response)

    def file_response(self, full_path: str | PathLike[str], *args: Any, **kwargs: Any) -> Response:
        """Return a file or 304 Not Modified; both carry the policy."""
        response = super().file_response(full_path, *args, **kwargs)
        if Path(full_path).name == _ICON:
            response.headers["Cache-Control"] = "max-age=3600"
        return _guarded(response)


def _guarded(response: Response) -> Response:
    response.headers["Content-Security-Policy"] = POLICY
    response.headers.setdefault("Cache-Control", "no-cache")
    return response
