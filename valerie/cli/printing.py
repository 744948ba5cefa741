"""Print HTML as PDF with an installed Chromium."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Final

from valerie.errors import MissingDependency, RenderingError

#: Browsers that print a page without a window.
_BROWSERS: Final = ("chromium", "chromium-browser", "google-chrome", "chrome", "microsoft-edge")
#: Timeout for one page.
_SECONDS: Final = 300


def pdf_of(html: bytes) -> bytes:
    """Return a page as PDF, with its print styles.

    Raises:
        MissingDependency: there is no Chromium.
        RenderingError: Chromium printed nothing.
    """
    browser = next(filter(None, map(shutil.which, _BROWSERS)), None)
    if browser is None:
        raise MissingDependency("a PDF needs Chromium or Chrome: install one, or print the HTML report from a browser")
    with tempfile.TemporaryDirectory(prefix="valerie-pdf-") as folder:
        page, target = Path(folder, "report.html"), Path(folder, "report.pdf")
        page.write_bytes(html)
        command = [
            browser,
            "--headless",
            "--disable-gpu",
            "--no-pdf-header-footer",
            f"--user-data-dir={folder}/profile",
        ]
        if os.geteuid() == 0:  # as root, in containers, Chromium has no sandbox; the page itself may connect to nothing
            command.append("--no-sandbox")
        command += [f"--print-to-pdf={target}", page.as_uri()]
        try:
            subprocess.run(command, check=True, capture_output=True, timeout=_SECONDS)
            return target.read_bytes()
        except (subprocess.SubprocessError, OSError) as error:
            raise RenderingError(f"{browser} printed no PDF: {error}") from error
