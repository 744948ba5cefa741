"""Take pictures of the documentation from a run of examples/first-run.yaml, most of the dashboard: ``make screenshots``.

The run uses the data folder of ``make run``, so what is there is not computed again. A server that runs is used.
"""

from __future__ import annotations

import io
import shutil
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Final, NamedTuple

import httpx
from PIL import Image
from playwright.sync_api import Page, sync_playwright

from tools.contact_sheet import captioned, contact_sheet, save_sheet
from valerie.embedded import running
from valerie.embedded.supervisor import Supervisor
from valerie.settings import load_settings

ROOT: Final = Path(__file__).parents[1]
SPEC: Final = ROOT / "examples" / "first-run.yaml"
IMAGES: Final = ROOT / "docs" / "images"
#: Variant, camera and sensor of the frame that is shown alone.
FRAME: Final = "5.0.0"
_WIDTH: Final = 1280
_TILE: Final = (720, 405)
_FLAGS: Final = ("--no-sandbox", "--disable-gpu")
_LOADED: Final = (
    "() => !document.querySelector('.waiting') && [...document.images]"
    ".every(one => one.loading === 'lazy' || (one.complete && one.naturalWidth))"
)


class Screenshot(NamedTuple):
    """A picture of a page.

    Attributes:
        name: of the file.
        address: of the page, with ``{run}`` for the run.
        shown: selector of what is drawn last.
        height: in pixels.
        prepare: what is done on the page before.
    """

    name: str
    address: str
    shown: str
    height: int
    prepare: Callable[[Page], None] = lambda _: None


def _read_a_pixel(page: Page) -> None:
    page.locator(".window").first.hover(position={"x": 280, "y": 175})
    page.wait_for_selector(".reading:has-text('truth')")


def _lower(page: Page) -> None:
    page.locator(".below").scroll_into_view_if_needed()
    page.evaluate("() => document.querySelector('.below').scrollIntoView({block: 'start'})")


FAR: Final = "dashboard/#/explore?runs={run}&where=distance_m+%3E+25+and+pacc+%3C+0.5"
SCREENSHOTS: Final = (
    Screenshot(
        "dashboard", f"dashboard/#/frames/{{run}}.{FRAME}?view=errors&near=1", ".viewer img[src]", 900, _read_a_pixel
    ),
    Screenshot("explore", FAR, ".thumbnail:not(.waiting)", 1750),
    Screenshot(
        "comparison", "dashboard/#/explore?runs={run}&tab=compare", ".pair .thumbnail:not(.waiting)", 900, _lower
    ),
    Screenshot(
        "confusion",
        "dashboard/#/explore?runs={run}&tab=confusion&cell=person~building",
        ".thumbnail:not(.waiting)",
        1000,
        _lower,
    ),
    Screenshot("new-run", "dashboard/#/new?run={run}", ".previews[aria-busy=false] img", 1265),
    Screenshot("report", "v1/runs/{run}/report", "main", 900),
)


def finished_run(url: str) -> str:
    """Submit the spec, and wait for the run's end."""
    with httpx.Client(base_url=url, timeout=60, trust_env=False) as client:
        answer = client.post("/v1/runs", content=SPEC.read_bytes(), headers={"Content-Type": "application/yaml"})
        run_id = str(answer.raise_for_status().json()["id"])
        while not (run := client.get(f"/v1/runs/{run_id}").raise_for_status().json())["finished_at"]:
            time.sleep(0.5)
    if run["state"] != "completed":
        raise SystemExit(f"the run is {run['state']}: {run['reason']}")
    return run_id


def frame_sheet(url: str, run: str) -> Image.Image:
    """Return a frame's picture, and truth and predictions over it."""
    functions = ("deeplabv3plus-small", "semantic-fpn-small")
    views = [("rendered picture", {"kind": "picture"}), ("ground truth", {"kind": "truth-overlay"})]
    views += [(name, {"kind": "overlay", "function": name}) for name in functions]
    tiles = []
    with httpx.Client(base_url=url, timeout=60, trust_env=False) as client:
        for caption, parameters in views:
            answer = client.get(f"/v1/frames/{run}.{FRAME}/image", params=parameters).raise_for_status()
            picture = Image.open(io.BytesIO(answer.content)).convert("RGB").resize(_TILE, Image.Resampling.LANCZOS)
            tiles.append(captioned(picture, _TILE, caption))
    return contact_sheet(tiles, 2)


def take(page: Page, url: str, run: str, shot: Screenshot) -> bytes:
    """Open a page and return its picture as PNG."""
    page.set_viewport_size({"width": _WIDTH, "height": shot.height})
    page.goto("about:blank")
    page.goto(f"{url.rstrip('/')}/{shot.address.format(run=run)}")
    page.wait_for_selector(shot.shown, timeout=120_000)
    page.wait_for_load_state("networkidle")
    page.wait_for_function(_LOADED)
    shot.prepare(page)
    page.wait_for_timeout(600)  # transitions
    sink = io.BytesIO()
    Image.open(io.BytesIO(page.screenshot(animations="disabled"))).convert("RGB").save(sink, "PNG", optimize=True)
    return sink.getvalue()


def main() -> None:
    """Take all pictures."""
    settings = load_settings()
    program = shutil.which("chromium") or shutil.which("google-chrome")
    if program is None:
        raise SystemExit("no Chromium is installed")
    with ExitStack() as stack:
        held = running.acquire(settings.data_dir)
        url = stack.enter_context(Supervisor(settings, held)).url if isinstance(held, running.Lock) else held.url
        run = finished_run(url)
        save_sheet(frame_sheet(url, run), IMAGES / "first-run.jpg")
        browser = stack.enter_context(sync_playwright()).chromium.launch(executable_path=program, args=[*_FLAGS])
        page = browser.new_page(reduced_motion="reduce")
        for shot in SCREENSHOTS:
            (IMAGES / f"{shot.name}.png").write_bytes(take(page, url, run, shot))
            print(f"docs/images/{shot.name}.png")
        browser.close()


if __name__ == "__main__":
    main()
