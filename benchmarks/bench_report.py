"""Measure how long the report of a large run takes to open in Chromium.

``make bench-report``, or ``python -m benchmarks.bench_report [--frames 30720] [--repetitions 5]``: the report of the planted run
of `benchmarks.bench_analysis`, two functions on 30,720 frames, with pictures of noise in full HD, a third of a megabyte each.
*Loaded* is the time from the navigation to the page's load event, *shown* that to the first text on the screen. *CPU* is the
time that the page's main thread worked meanwhile, which does not depend on other programs; figures are drawn when they come
near the screen, and *all drawn* adds those of the whole page. All are of a fresh browser context and the median of the
repetitions.
"""

from __future__ import annotations

import argparse
import os
import shutil
import tempfile
from io import BytesIO
from itertools import count
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from PIL import Image
from playwright.sync_api import CDPSession, sync_playwright

from benchmarks import results
from benchmarks.bench_analysis import paper_table, planted_report
from valerie.analysis.report.model import PictureSource

_TIMES = """() => {
  const [navigation] = performance.getEntriesByType("navigation");
  const paint = performance.getEntriesByName("first-contentful-paint")[0];
  return [paint ? paint.startTime : null, navigation.loadEventEnd];
}"""


def noise() -> PictureSource:
    """Return a source of pictures, each another one, as large as those of frames in full HD."""
    seeds = count()

    def picture(*_: object, **__: object) -> bytes:
        grey = np.random.default_rng(next(seeds)).integers(0, 256, (135, 240), np.uint8)
        sink = BytesIO()
        Image.fromarray(grey).resize((1920, 1080)).convert("RGB").save(sink, "JPEG")
        return sink.getvalue()

    return picture


def _worked(session: CDPSession) -> float:
    """Return the CPU seconds of the page's main thread so far."""
    metrics = {metric["name"]: float(metric["value"]) for metric in session.send("Performance.getMetrics")["metrics"]}
    return metrics["TaskDuration"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=30_720)
    parser.add_argument("--repetitions", type=int, default=5)
    arguments = parser.parse_args()
    table = paper_table(arguments.frames)
    html = planted_report(table, picture=noise())
    figures: dict[str, Any] = {"rows": len(table), "report, MB": round(len(html.encode()) / 1e6, 1)}
    figures["pictures"] = html.count("<img ")
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        page_file = Path(folder, "report.html")
        page_file.write_text(html, "utf-8")
        program = shutil.which("chromium") or shutil.which("google-chrome")
        flags = ["--no-sandbox"] if os.geteuid() == 0 else []
        browser = playwright.chromium.launch(executable_path=program, args=flags)
        shown, loaded, worked, whole = [], [], [], []
        for _ in range(arguments.repetitions):
            page = browser.new_context().new_page()
            session = page.context.new_cdp_session(page)
            session.send("Performance.enable", {"timeDomain": "threadTicks"})
            page.goto(page_file.as_uri(), wait_until="load")
            page.wait_for_timeout(100)
            first, load = page.evaluate(_TIMES)
            shown.append(first)
            loaded.append(load)
            worked.append(_worked(session))
            for figure in page.query_selector_all(".plot"):
                figure.scroll_into_view_if_needed()
            page.wait_for_function("() => document.querySelectorAll('.plot:not(.drawn)').length === 0")
            page.wait_for_timeout(100)
            whole.append(_worked(session))
            page.context.close()
        browser.close()
    figures["shown, s"] = round(median(shown) / 1000, 2)
    figures["loaded, s"] = round(median(loaded) / 1000, 2)
    figures["main thread, CPU s"] = round(median(worked), 2)
    figures["all drawn, CPU s"] = round(median(whole), 2)
    for name, value in figures.items():
        print(f"{name}: {value:,}")
    results.write("report", figures)


if __name__ == "__main__":
    main()
