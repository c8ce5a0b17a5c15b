"""The page in a real browser at the client's end of the link, before the real services."""

from __future__ import annotations

import math
import shutil
import time
from collections.abc import Iterator
from contextlib import closing
from http.client import HTTPConnection
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Page, expect, sync_playwright

from tests.eventually import wait_until
from tests.prerequisites import BUILT_PAGE, CHROMIUM
from tests.testbed.conftest import NOBODY, ShaperProcess
from tests.testbed.inside import inside
from tests.web.conftest import CHROMIUM_ARGS, DESKTOP, PATIENCE
from tests.web.modes import wait_for_stream
from tests.web.scenes import write_scenes
from tests.web.stage import SCENE, frames, wait_for_frames
from tigas_common.processes import STOP_S, terminate
from tigas_common.topology import DASH, PAGE, PAGE_ORIGINS, SERVICES_VARIABLE, Port, services_json
from tigas_common.wire.shaper import LinkSetting
from tigas_shaper.traces.trace import NetworkTrace
from tigas_testbed.namespaces import Lab
from tigas_testbed.services import Runner, dash_command, render_command

OUTAGE_S = 5
DELAY_MS = 60
NOTE_FRAMES = """() => {
  window.times = [performance.now()];
  const note = () => window.times.push(performance.now());
  new MutationObserver(note).observe(document.querySelector(".stage"), { attributeFilter: ["data-frames"] });
}"""
"""Notes in the page when frames are shown."""


@pytest.fixture
def render(lab: Lab, tmp_path: Path) -> Iterator[None]:
    """The render service and the packager in their namespace."""
    BUILT_PAGE.require()
    write_scenes(tmp_path)
    tmp_path.chmod(0o755)  # the service's user is another one
    runner = Runner(lab, NOBODY, [tmp_path])
    services = {SERVICES_VARIABLE: services_json(shaped=True)}
    started = (
        runner.start(runner.service(render_command(tmp_path)), services),
        runner.start(runner.service(dash_command())),
    )
    try:
        wait_until(lambda: answers(lab, PAGE) and answers(lab, DASH), 90)
        yield
    finally:
        for process in started:
            terminate(process, STOP_S)


def answers(lab: Lab, port: Port) -> bool:
    """Whether a client gets an answer from a service. It listens before its rasteriser is ready."""
    with inside(lab, "client"), closing(HTTPConnection("127.0.0.1", port.number, timeout=5)) as connection:
        try:
            connection.request("GET", "/healthz")
            return connection.getresponse().status < 500
        except OSError:
            return False


@pytest.fixture
def page(lab: Lab, render: None, tmp_path: Path) -> Iterator[Page]:
    """A page in a browser that lives in the client's namespace."""
    CHROMIUM.require()
    chromium = shutil.which("chromium")
    wrapper = tmp_path / "chromium"
    wrapper.write_text(f'#!/bin/sh\nexec ip netns exec {lab.namespace("client")} {chromium} "$@"\n')
    wrapper.chmod(0o755)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=wrapper, args=CHROMIUM_ARGS)
        made = browser.new_page(viewport=DESKTOP)
        made.set_default_timeout(PATIENCE)
        yield made
        browser.close()


def test_the_page_crosses_the_link_and_survives_an_outage(link: ShaperProcess, page: Page) -> None:
    link.post("/link", down_kbps=10_000, up_kbps=5_000, delay_ms=10)
    page.goto(f"{PAGE_ORIGINS[0]}/{SCENE}", wait_until="commit")
    assert page.evaluate("isSecureContext")
    expect(page.locator(".stage")).to_have_attribute("data-transport", "webtransport-streams", timeout=PATIENCE)
    wait_for_frames(page)
    outage = NetworkTrace("cut", (0, OUTAGE_S * 1000), (LinkSetting(0, 0), LinkSetting(10_000, 5_000, 10)), 60_000)
    start = link.play(outage)
    page.evaluate(NOTE_FRAMES)
    page.keyboard.down("ArrowRight")  # the view changes all the while, so that frames are always wanted
    page.wait_for_timeout(max(0.0, start + OUTAGE_S - time.monotonic()) * 1000)
    wait_for_frames(page, frames(page) + 10)
    print(f"10 frames {time.monotonic() - start - OUTAGE_S:.1f} s after the outage")
    assert np.diff(page.evaluate("window.times")).max() > 0.6 * OUTAGE_S * 1000, "nothing passes in an outage"
    expect(page.locator(".stage")).to_have_attribute("data-transport", "webtransport-streams", timeout=PATIENCE)
    page.keyboard.up("ArrowRight")


@pytest.mark.slow
@pytest.mark.extended
def test_webrtc_crosses_the_link_on_its_one_port(link: ShaperProcess, page: Page) -> None:
    link.post("/link", down_kbps=5_000, up_kbps=5_000, delay_ms=DELAY_MS)
    page.goto(f"{PAGE_ORIGINS[0]}/{SCENE}")
    page.wait_for_function("() => globalThis.tigas !== undefined")
    plain = "mode: 'webrtc', webrtcStream: 'vp8-30', reprojection: false, prediction: 'off'"
    page.evaluate(f"tigas.settings({{ {plain} }})")
    wait_for_stream(page, at_least=5)
    page.wait_for_function("() => tigas.state().ready")
    points = [
        {"t_ms": t, "position": [0, 0, 0], "quaternion": [0, math.sin(t / 2000), 0, math.cos(t / 2000)]}
        for t in range(0, 1001, 100)
    ]
    run = page.evaluate("plan => tigas.run(plan)", {"points": points, "duration_ms": 1000, "capture_every_ms": 0})
    latencies = [latency for frame in run["frames"] for latency in frame["latencies"]]
    assert len(latencies) > 5
    assert min(latencies) > 2 * DELAY_MS, "it did not cross the link"
