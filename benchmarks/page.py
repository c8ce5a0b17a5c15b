"""Cost of the page in a browser: main-thread time per picture, and memory over a long walk.

    python -m benchmarks.page [--throttle 4] [--seconds 10] [--blocks 5] [--frames 3600 36000]

The service sends grey pictures of 23 kB at once, so that the machine is left to the browser. A walk holds the arrow
keys, a quarter of a second each. A picture's time, from Chromium's trace, is all since the one before: `script` is that
of the page's callbacks with their microtasks and garbage collection, in processor time of the thread; `elapsed` the
same by the clock, with waits for a processor; `tasks` the processor time of everything. The pictures are not drawn. The
processor is slowed down as Chromium's developer tools do it. Memory is the JavaScript heap after collection, after
walks of so many frames.
"""

from __future__ import annotations

import argparse
import json
import statistics
from bisect import bisect
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from playwright.sync_api import Browser, CDPSession, Page, ViewportSize, sync_playwright

from benchmarks.load.server import started
from tigas_experiments.run.browser import ARGUMENTS, find_chromium

Event = dict[str, Any]

SIZE: ViewportSize = {"width": 1280, "height": 720}
KEYS = ("ArrowRight", "w", "ArrowLeft", "s")
KEY_MS = 250
FRAMES = "() => Number(document.querySelector('.stage')?.dataset.frames ?? 0)"
SETTINGS = {"refine": False, "reprojection": False, "surround": False, "sidebar": False, "hud": False}
PREPARE = """() => {
  document.querySelector(".pane").style.visibility = "hidden";
  const { prototype } = ImageBitmapRenderingContext;
  const show = prototype.transferFromImageBitmap;
  prototype.transferFromImageBitmap = function (picture) {
    console.timeStamp();
    return show.call(this, picture);
  };
}"""
"""Mark pictures in the trace and hide them: drawn in software, they take up to two thirds of a processor."""
CATEGORIES = ["devtools.timeline", "disabled-by-default-devtools.timeline"]
CALLBACKS = ("FireAnimationFrame", "HandlePostMessage", "EventDispatch", "TimerFire")
COSTS = {"script": (CALLBACKS, "tdur"), "elapsed": (CALLBACKS, "dur"), "tasks": (("RunTask",), "tdur")}
"""Events of a trace, and the clock that times them."""
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
        yield page, context.new_cdp_session(page)


def walk(page: Page, seconds: float) -> None:
    for step in range(round(seconds * 1000 / KEY_MS)):
        page.keyboard.press(KEYS[step % len(KEYS)], delay=KEY_MS)


def traced(browser: Browser, page: Page, seconds: float) -> list[Event]:
    browser.start_tracing(page=page, categories=CATEGORIES)
    walk(page, seconds)
    events: list[Event] = json.loads(browser.stop_tracing())["traceEvents"]
    return sorted((event for event in events if event["ph"] in "XI"), key=lambda event: event["ts"])


def per_picture(events: list[Event], names: Sequence[str], clock: str) -> list[float]:
    """The main thread's milliseconds for each picture, in the outermost events of these names."""
    pictures = [event for event in events if event["name"] == "TimeStamp"]
    shown = [event["ts"] for event in pictures]
    times, end = [0.0] * (len(shown) + 1), 0
    for event in events:
        if event["name"] in names and event["tid"] == pictures[0]["tid"] and event["ts"] >= end:
            end = event["ts"] + event["dur"]
            times[bisect(shown, event["ts"])] += event[clock] / 1000
    return times[1:-1]


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
                page.evaluate(PREPARE)
                cdp.send("Emulation.setCPUThrottlingRate", {"rate": options.throttle})
                walk(page, WARM_UP_S)
                events = traced(browser, page, options.seconds)
                print(f"slowed down {options.throttle:g} times", end="")
                for name, (names, clock) in COSTS.items():
                    times = per_picture(events, names, clock)
                    p95 = statistics.quantiles(times, n=20)[18]
                    print(f"; {name} {statistics.median(times):.2f} ms a picture, p95 {p95:.2f}", end="")
                print(f"; {len(times) / options.seconds:.1f} pictures/s", flush=True)
        with viewer(browser, url) as (page, cdp):
            for frames in options.frames:
                while int(page.evaluate(FRAMES)) < frames:
                    walk(page, 10)
                print(f"heap after {page.evaluate(FRAMES):,} frames: {heap(cdp):.2f} MB", flush=True)
        browser.close()


if __name__ == "__main__":
    main()
