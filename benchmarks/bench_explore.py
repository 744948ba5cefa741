"""Measure the page Explore with a million rows: time to the first view, from a brush to all linked views, memory of the tab.

A planted table is stored as that of a completed run; Debian's Chromium draws with its software renderer.
``python -m benchmarks.bench_explore [ROWS]``. Thumbnails are measured on runs of drawn frames of two sizes; the server
caches thumbnails that it has painted.
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
from tests.world.drawn import FUNCTIONS, DrawnWorld, spec
from tests.world.serving import served
from tests.world.world import settings_of
from valerie.analysis.rows.design import Design
from valerie.analysis.rows.table import EvaluationTable
from valerie.pipeline.base.run_artifacts import TABLE_PARQUET
from valerie.storage.keys import run_key

BRUSHES = 30
_FLAGS = ["--no-sandbox", "--disable-gpu", "--enable-precise-memory-info"]
_SHOWN = "() => performance.getEntriesByName('explore-shown').length"


def planted(run: str, rows: int) -> EvaluationTable:
    """Return rows of two functions and two cameras, from random variants; a twentieth has no pACC."""
    generator = np.random.default_rng(17)
    variants = rows // 4
    distance = 5 + 55 * generator.random(rows)
    pacc = np.clip(1.1 - distance / 60 + 0.2 * generator.standard_normal(rows), 0, 1)
    pacc[generator.random(rows) < 0.05] = np.nan
    frames = [f"{run}.{variant}.{camera}.0" for variant in range(variants) for camera in (0, 0, 1, 1)]
    return planted_table(
        pacc,
        np.repeat(np.arange(variants), 4),
        design=Design((("random", variants),)),
        run_id=run,
        frame_id=frames,
        function=list(FUNCTIONS) * (2 * variants),
        camera=["camera-1", "camera-1", "camera-2", "camera-2"] * variants,
        distance_m=distance,
        occlusion_rate=np.where(generator.random(rows) < 0.1, np.nan, generator.random(rows) ** 3),
        sun_elevation_deg=np.repeat(60 * generator.random(variants), 4),
        picture_mean=255 * generator.random(rows),
        truncation_rate=np.zeros(rows),
        **{X: np.repeat(1000 * generator.random(variants), 4)},
    )


def first_view(page: Page, address: str) -> float:
    """Return the seconds from opening the page until all its views are drawn."""
    started = time.perf_counter()
    page.goto(address)
    page.wait_for_function(_SHOWN, timeout=120_000)
    return time.perf_counter() - started


def brush(page: Page, generator: np.random.Generator) -> float:
    """Drag over a histogram; return the milliseconds from the request to all linked views."""
    page.wait_for_timeout(700)  # rates, which follow the views
    bars = page.locator(".histogram-canvas").nth(int(generator.integers(3)))
    bars.scroll_into_view_if_needed()
    box = bars.bounding_box()
    assert box is not None
    x, width = box["x"] + box["width"] * generator.uniform(0.05, 0.6), box["width"] * generator.uniform(0.1, 0.35)
    page.evaluate("() => { performance.clearMarks(); }")
    page.mouse.move(x, box["y"] + 40)
    page.mouse.down()
    page.mouse.move(x + width, box["y"] + 40)
    page.evaluate("() => { performance.mark('released'); }")
    page.mouse.up()
    page.wait_for_timeout(150)
    page.wait_for_function(f"() => ({_SHOWN})()", timeout=60_000)
    took: float = page.evaluate(
        "() => performance.getEntriesByName('explore-shown').at(-1).startTime"
        " - performance.getEntriesByName('explore-asked').at(-1).startTime"
    )
    return took


def thumbnails(client: httpx.Client, run: str) -> dict[str, float]:
    """Return thumbnails per CPU second of server and client, painted for the first time and from the cache."""
    rows = client.get("/v1/explore/rows", params={"run": run, "limit": 64}).json()["items"]
    tiles = [f"{row['frame_id']}:{row['instance_id'] or 0}:{row['function']}:{row['sensor']}" for row in rows][:64]
    parameters: dict[str, Any] = {"tile": tiles, "kind": "errors", "crop": True}
    rates = {}
    for name, rounds in (("first", 1), ("kept", 10)):
        started = time.process_time()
        for _ in range(rounds):
            client.get("/v1/explore/sheet", params=parameters).raise_for_status()
        rates[name] = rounds * len(tiles) / (time.process_time() - started)
    return rates


def _cpu_seconds(processes: list[psutil.Process]) -> float:
    return sum(process.cpu_times().user + process.cpu_times().system for process in processes if process.is_running())


def main() -> None:
    """Measure, print and write the figures."""
    rows = int(sys.argv[1]) if len(sys.argv) > 1 else 1_000_000
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    with tempfile.TemporaryDirectory(prefix="valerie-bench-") as folder:
        settings = settings_of(Path(folder), log_level="error")
        world = DrawnWorld(settings)
        small, large = world.work(spec("thumbnails")), world.work(spec("million", seed=1))
        full = world.work(spec("full size", width=960, height=540))
        sink = io.BytesIO()
        planted(large, rows).to_parquet(sink)
        world.context.store.put(run_key(large, TABLE_PARQUET), sink.getvalue())
        world.context.engine.dispose()
        del sink
        with served(create_app(settings, control=False)) as client, sync_playwright() as playwright:
            client.timeout = httpx.Timeout(120)
            browser = playwright.chromium.launch(executable_path="/usr/bin/chromium", args=_FLAGS)
            page = browser.new_page(viewport={"width": 1400, "height": 1000})
            # Six histograms, a density, six axes, a page of rows with its thumbnails.
            columns = f"pacc,distance_m,occlusion_rate,function,sun_elevation_deg,{X}"
            address = f"{client.base_url}/explore?runs={large}&tab=table&h={columns}&p={columns}"
            cold = first_view(page, address)
            page.goto("about:blank")
            warm = first_view(page, address)
            generator = np.random.default_rng(5)
            browser_processes = [
                process for process in psutil.Process().children(recursive=True) if "chrom" in process.name()
            ]
            before = _cpu_seconds([psutil.Process(), *browser_processes])
            took = [brush(page, generator) for _ in range(BRUSHES)]
            cpu = (_cpu_seconds([psutil.Process(), *browser_processes]) - before) / BRUSHES
            heap = page.evaluate("() => performance.memory.usedJSHeapSize") / 2**20
            renderers = [
                process
                for process in psutil.Process().children(recursive=True)
                if "--type=renderer" in process.cmdline()
            ]
            tab = max(process.memory_full_info().uss for process in renderers) / 2**20
            rates = thumbnails(client, small)
            rates["first of 960x540"] = thumbnails(client, full)["first"]
            browser.close()
    figures = {
        "rows": rows,
        "first_view_cold_s": round(cold, 2),
        "first_view_s": round(warm, 2),
        "brush_ms": {"p50": round(float(np.median(took))), "p95": round(float(np.quantile(took, 0.95)))},
        "cpu_per_brush_ms": round(1000 * cpu),  # of server and browser together, rates and rows included
        "tab_mb": round(tab),
        "heap_mb": round(heap),
        "thumbnails_per_cpu_s": {name: round(rate) for name, rate in rates.items()},
    }
    for name, value in figures.items():
        print(f"{name:20} {value}")
    results.write("explore", figures)


if __name__ == "__main__":
    main()
