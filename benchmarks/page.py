"""Cost of the page in a browser: main-thread time per frame, and memory over a long walk.

    python -m benchmarks.page [--throttle 4] [--seconds 10] [--blocks 5] [--frames 3600 36000]

The service sends grey pictures of 23 kB at once, so that the machine is left to the browser. A walk holds the arrow
keys, a quarter of a second each; a frame's time is that of a quarter divided by its frames. `script` is the time of
the page's own code, `tasks` includes the browser's drawing, which is in software without a graphics processor. The
processor is slowed down as Chromium's developer tools do it. Memory is the JavaScript heap after collection, after
walks of so many frames.
"""

from __future__ import annotations

import argparse
import json
import statistics
import time
from collections.abc import Iterator
from contextlib import contextmanager

from playwright.sync_api import Browser, CDPSession, Page, ViewportSize, sync_playwright

from benchmarks.load.server import started
from tigas_experiments.run.browser import ARGUMENTS, find_chromium

SIZE: ViewportSize = {"width": 1280, "height": 720}
KEYS = ("ArrowRight", "w", "ArrowLeft", "s")
KEY_MS = 250
FRAMES = "() => Number(document.querySelector('.stage')?.dataset.frames ?? 0)"
SETTINGS = {"refine": False, "reprojection": False, "surround": False, "sidebar": False, "hud": False}
METRICS = {"script": "ScriptDuration", "tasks": "TaskDuration"}
WARM_UP_S = 3


@contextmanager
def viewer(browser: Browser, url: str) -> Iterator[tuple[Page, CDPSession]]:
    """An open viewer that shows frames."""
    with browser.new_context(viewport=SIZE) as context:
        stored = json.dumps(json.dumps(SETTINGS))
        context.add_init_script(f"localStorage.setItem('tigas.settings', {stored})")
        page = context.new_page()
        page.goto(f"{url}/#/scene/courtyard")
        page.wait_for_function(f"{FRAMES} > 0")
        cdp = context.new_cdp_session(page)
        cdp.send("Performance.enable")
        yield page, cdp


def walk(page: Page, cdp: CDPSession, seconds: float) -> list[dict[str, float]]:
    """For each quarter of a second: its frames, and the milliseconds of each metric per frame."""
    quarters = []
    before, shown = _metrics(cdp), page.evaluate(FRAMES)
    for step in range(round(seconds * 1000 / KEY_MS)):
        page.keyboard.press(KEYS[step % len(KEYS)], delay=KEY_MS)
        now, frames = _metrics(cdp), page.evaluate(FRAMES)
        if new := frames - shown:
            quarters.append({"frames": new} | {name: 1000 * (now[name] - before[name]) / new for name in METRICS})
        before, shown = now, frames
    return quarters


def _metrics(cdp: CDPSession) -> dict[str, float]:
    values = {one["name"]: one["value"] for one in cdp.send("Performance.getMetrics")["metrics"]}
    return {name: values[metric] for name, metric in METRICS.items()}


def heap(cdp: CDPSession) -> float:
    """The JavaScript heap after collection, in megabytes."""
    cdp.send("HeapProfiler.collectGarbage")
    return float(cdp.send("Runtime.getHeapUsage")["usedSize"]) / 1e6


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--throttle", type=float, default=4)
    parser.add_argument("--seconds", type=float, default=10)
    parser.add_argument("--blocks", type=int, default=5)
    parser.add_argument("--frames", type=int, nargs="*", default=[3600, 36_000])
    options = parser.parse_args()
    with started("service", ("--device", "instant")) as server, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=find_chromium(), args=[*ARGUMENTS, "--no-sandbox"])
        url = server.url.replace("127.0.0.1", "localhost")
        for _ in range(options.blocks):
            with viewer(browser, url) as (page, cdp):
                cdp.send("Emulation.setCPUThrottlingRate", {"rate": options.throttle})
                walk(page, cdp, WARM_UP_S)
                began = time.monotonic()
                quarters = walk(page, cdp, options.seconds)
                rate = sum(quarter["frames"] for quarter in quarters) / (time.monotonic() - began)
                print(f"slowed down {options.throttle:g} times: {rate:5.1f} frames/s", end="")
                for name in METRICS:
                    times = [quarter[name] for quarter in quarters]
                    p95 = statistics.quantiles(times, n=20)[18]
                    print(f"; {name} {statistics.median(times):.2f} ms a frame, p95 {p95:.2f}", end="")
                print(flush=True)
        with viewer(browser, url) as (page, cdp):
            for frames in options.frames:
                while int(page.evaluate(FRAMES)) < frames:
                    walk(page, cdp, 10)
                print(f"heap after {page.evaluate(FRAMES):,} frames: {heap(cdp):.2f} MB", flush=True)
        browser.close()


if __name__ == "__main__":
    main()
