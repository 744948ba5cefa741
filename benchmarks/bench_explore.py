"""Measure the page Explore with a million rows in Debian's Chromium with its software renderer.

A planted table is stored as that of a completed run; its rows show the frames of a drawn run of 960 x 540 pixels. Times are
wall times: from the address, or from the last movement of the mouse, until the page has painted. `views` are histograms,
density, parallel coordinates and the rows; `thumbnails` also the 48 pictures of these rows; `rates` also the rates with
intervals. `frames` are the pictures a second of a scatter plot of as many points as the page draws one by one, while a
brush is dragged over it.
``python -m benchmarks.bench_explore [ROWS]``.
"""

from __future__ import annotations

import io
import os
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import psutil
from playwright.sync_api import Page, sync_playwright

from benchmarks import results
from services.api.app import create_app
from tests.planted_tables import X, planted_table
from tests.world.drawn import CHARACTERS, FUNCTIONS, DrawnWorld, spec
from tests.world.serving import served
from tests.world.world import settings_of
from valerie.analysis.rows.design import Design
from valerie.analysis.rows.table import EvaluationTable
from valerie.db.engine import reading
from valerie.db.frames import page as page_of_frames
from valerie.pipeline.base.run_artifacts import TABLE_PARQUET
from valerie.pipeline.exploring.linked_views import MAX_POINTS
from valerie.pipeline.exploring.thumbnails import MAX_TILES
from valerie.storage.keys import run_key

BRUSHES = 30
#: Of the frames that are shown: three sheets of thumbnails.
PLACES = [
    ["person-1.pos.x", "HOMOGENEOUS", -1.0, 2.5, 3.5],
    ["person-1.pos.y", "HOMOGENEOUS", 5.0, 35.0, 2.5],
    ["person-1.character", "CHOICE", list(CHARACTERS)],
]
_FLAGS = ["--no-sandbox", "--disable-gpu"]
#: Notes when the frame after each of the page's marks is painted.
_WATCH = """
window.painted = {};
new PerformanceObserver((list) => {
  for (const { name } of list.getEntries()) {
    requestAnimationFrame(() => setTimeout(() => { window.painted[name] = performance.now(); }));
  }
}).observe({ type: "mark" });
"""
_MARKS = {"views": "explore-shown", "thumbnails": "explore-pictured", "rates": "explore-rated"}
_ALL = f"() => {list(_MARKS.values())}.every((name) => window.painted[name])"


def planted(run: str, rows: int, frames: list[str]) -> EvaluationTable:
    """Return rows of two functions and two cameras, from random variants; a twentieth has no pACC.

    Args:
        run: its id.
        rows: their number.
        frames: ids of frames that have pictures, which the rows show in turn.
    """
    generator = np.random.default_rng(17)
    variants = rows // 4
    distance = 5 + 55 * generator.random(rows)
    pacc = np.clip(1.1 - distance / 60 + 0.2 * generator.standard_normal(rows), 0, 1)
    pacc[generator.random(rows) < 0.05] = np.nan
    return planted_table(
        pacc,
        np.repeat(np.arange(variants), 4),
        design=Design((("random", variants),)),
        run_id=run,
        frame_id=np.repeat(np.resize(frames, rows // 2), 2).tolist(),
        instance_id=np.full(rows, 24001.0),
        function=list(FUNCTIONS) * (2 * variants),
        camera=["camera-1", "camera-1", "camera-2", "camera-2"] * variants,
        distance_m=distance,
        occlusion_rate=np.where(generator.random(rows) < 0.1, np.nan, generator.random(rows) ** 3),
        sun_elevation_deg=np.repeat(60 * generator.random(variants), 4),
        picture_mean=255 * generator.random(rows),
        truncation_rate=np.zeros(rows),
        **{X: np.repeat(1000 * generator.random(variants), 4)},
    )


def first_view(page: Page, address: str) -> dict[str, float]:
    """Return the seconds from opening the page until each part is painted."""
    page.goto("about:blank")
    page.goto(address)
    page.wait_for_function(_ALL, timeout=120_000)
    return {part: page.evaluate("(name) => window.painted[name] / 1000", name) for part, name in _MARKS.items()}


def brush(page: Page, generator: np.random.Generator) -> dict[str, float]:
    """Drag over a histogram; return the milliseconds from the last movement until each part is painted."""
    bars = page.locator(".histogram-canvas").nth(int(generator.integers(3)))
    bars.scroll_into_view_if_needed()
    box = bars.bounding_box()
    assert box is not None
    x, width = box["x"] + box["width"] * generator.uniform(0.05, 0.6), box["width"] * generator.uniform(0.1, 0.35)
    page.mouse.move(x, box["y"] + 40)
    page.mouse.down()
    page.wait_for_timeout(1000)
    page.evaluate(
        "() => addEventListener('pointermove', () => { window.painted = { moved: performance.now() }; },"
        " { capture: true, once: true })"
    )
    page.mouse.move(x + width, box["y"] + 40)
    page.wait_for_function(_ALL, timeout=60_000)
    took = {
        part: float(page.evaluate("(name) => window.painted[name] - window.painted.moved", name))
        for part, name in _MARKS.items()
    }
    page.mouse.up()
    page.wait_for_timeout(1000)  # the same selection again
    return took


#: Counts painted frames.
_COUNT = """
() => {
  window.framesPainted = 0;
  const next = () => { window.framesPainted += 1; requestAnimationFrame(next); };
  next();
}
"""


def frames_per_second(page: Page, address: str) -> float:
    """Return the painted frames a second while a brush is dragged over nearly `MAX_POINTS` points."""
    page.goto("about:blank")
    page.goto(address)
    page.wait_for_function(_ALL, timeout=120_000)
    shown = int(page.locator(".select strong").inner_text().split()[0].replace(",", ""))
    assert 0.8 * MAX_POINTS < shown <= MAX_POINTS, "they are drawn one by one"
    box = page.locator(".scatter-canvas").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + 80, box["y"] + 30)
    page.mouse.down()
    page.evaluate(_COUNT)
    started = time.perf_counter()
    for step in range(120):
        page.mouse.move(box["x"] + 90 + 2 * step, box["y"] + 40 + step)
    rate = page.evaluate("() => window.framesPainted") / (time.perf_counter() - started)
    page.keyboard.press("Escape")
    page.mouse.up()
    return float(rate)


#: Fetches sheets of thumbnails, decodes them and paints them.
_SHEETS = """
async (addresses) => {
  const started = performance.now();
  const canvas = new OffscreenCanvas(1280, 1280).getContext("2d");
  await Promise.all(addresses.map(async (address) => {
    canvas.drawImage(await createImageBitmap(await (await fetch(address, { cache: "no-store" })).blob()), 0, 0);
  }));
  canvas.getImageData(0, 0, 1, 1);
  return (performance.now() - started) / 1000;
}
"""


def thumbnails(page: Page, client: httpx.Client, run: str) -> dict[str, float]:
    """Return thumbnails a second in the browser, from sheets painted for the first time and from the server's cache."""
    rows = client.get("/v1/explore/rows", params={"run": run, "limit": 1000}).json()["items"]
    tiles = [f"{row['frame_id']}:{row['instance_id'] or 0}:{row['function']}:{row['sensor']}" for row in rows]
    client.get("/v1/explore/sheet", params={"tile": tiles[:1], "kind": "picture"}).raise_for_status()  # loads libraries
    sheets = [tiles[k : k + MAX_TILES] for k in range(0, len(tiles) - MAX_TILES + 1, MAX_TILES)]
    rates = {}
    for name, kind in (("first", "errors"), ("again", "errors"), ("first, picture", "picture")):
        addresses = [
            f"/v1/explore/sheet?{httpx.QueryParams({'tile': sheet, 'kind': kind, 'crop': '1'})}" for sheet in sheets
        ]
        rates[name] = len(sheets) * MAX_TILES / float(page.evaluate(_SHEETS, addresses))
    return rates


def main() -> None:
    """Measure, print and write the figures."""
    rows = int(sys.argv[1]) if len(sys.argv) > 1 else 1_000_000
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    with tempfile.TemporaryDirectory(prefix="valerie-bench-") as folder:
        settings = settings_of(Path(folder), log_level="error")
        world = DrawnWorld(settings)
        large, shown = world.work(spec("million")), world.work(spec("pictures", width=960, height=540, vary=PLACES))
        with reading(world.context.engine) as connection:
            frames = [str(one.frame.key) for one in page_of_frames(connection, shown, limit=1000)]
        sink = io.BytesIO()
        planted(large, rows, frames).to_parquet(sink)
        world.context.store.put(run_key(large, TABLE_PARQUET), sink.getvalue(), replace=True)
        world.context.engine.dispose()
        del sink
        with served(create_app(settings, control=False)) as client, sync_playwright() as playwright:
            client.timeout = httpx.Timeout(120)
            browser = playwright.chromium.launch(executable_path="/usr/bin/chromium", args=_FLAGS)
            page = browser.new_page(viewport={"width": 1400, "height": 1000})
            page.add_init_script(_WATCH)
            page.goto(f"{client.base_url}/dashboard/")
            rates = thumbnails(page, client, shown)
            # Six histograms, a density, six axes, and the worst rows with their pictures.
            columns = f"pacc,distance_m,occlusion_rate,function,sun_elevation_deg,{X}"
            address = f"{client.base_url}/explore?runs={large}&h={columns}&p={columns}"
            cold, warm = first_view(page, address), first_view(page, address)
            generator = np.random.default_rng(5)
            brushes = [brush(page, generator) for _ in range(BRUSHES)]
            renderers = [
                process
                for process in psutil.Process().children(recursive=True)
                if "--type=renderer" in process.cmdline()
            ]
            tab = max(process.memory_full_info().uss for process in renderers) / 2**20
            rate = frames_per_second(page, f"{address}&where=distance_m+%3C+{5 + 55 * 0.9 * MAX_POINTS / rows}")
            assert f"of {rows:,} rows" in page.locator(".select strong").inner_text(), "the planted rows are explored"
            browser.close()
    took = {part: [one[part] for one in brushes] for part in _MARKS}
    figures: dict[str, Any] = {
        "rows": rows,
        "first_view_cold_s": {part: round(seconds, 2) for part, seconds in cold.items()},
        "first_view_s": {part: round(seconds, 2) for part, seconds in warm.items()},
        "brush_ms_p50": {part: round(float(np.median(values))) for part, values in took.items()},
        "brush_ms_p95": {part: round(float(np.quantile(values, 0.95))) for part, values in took.items()},
        "thumbnails_per_s": {name: round(rate) for name, rate in rates.items()},
        "frames_per_s": round(rate),
        "tab_mb": round(tab),
    }
    figures["missed"] = missed(figures)
    for name, value in figures.items():
        print(f"{name:20} {value}")
    results.write("explore", figures)


def missed(figures: dict[str, Any]) -> list[str]:
    """Return the aims that the figures miss, in words."""
    measured = {
        "first view of all views, cold server": (figures["first_view_cold_s"]["views"], 2.0, "s"),
        "brush to all views, 95th percentile": (figures["brush_ms_p95"]["views"], 200, "ms"),
        "memory of the tab": (figures["tab_mb"], 500, "MB"),
    }
    slow = [
        f"thumbnails, {name}: {rate} a second; aim: at least 500"
        for name, rate in figures["thumbnails_per_s"].items()
        if rate < 500
    ]
    if figures["frames_per_s"] < 30:
        slow.append(f"frames of the scatter plot: {figures['frames_per_s']} a second; aim: at least 30")
    return [
        f"{name}: {value:g} {unit}; aim: at most {aim:g}"
        for name, (value, aim, unit) in measured.items()
        if value > aim
    ] + slow


if __name__ == "__main__":
    main()
