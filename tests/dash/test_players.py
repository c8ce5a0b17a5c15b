"""Independent players on a real stream: Shaka Player in Chromium, and ffmpeg. The viewer's tests use dash.js."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.request import Request, urlopen

import pytest
from playwright.sync_api import Page, sync_playwright

from tests import prerequisites
from tests.dash.conftest import session_request
from tests.prerequisites import FFMPEG, NODE_MODULES
from tests.web.conftest import CHROMIUM, CHROMIUM_ARGS, models
from tests.web.server import Packager, RenderServer

pytestmark = pytest.mark.slow

__all__ = ["models"]
SHAKA = Path(__file__).parents[2] / "web/node_modules/shaka-player/dist/shaka-player.compiled.js"
PAGE = """<!doctype html><video muted style="width: 640px"></video><script src="/shaka.js"></script><script>
const video = document.querySelector("video");
const player = new shaka.Player();
window.result = () => ({time: video.currentTime, frames: video.getVideoPlaybackQuality().totalVideoFrames,
                        width: video.videoWidth, failed: window.failed});
window.choose = (height) => player.selectVariantTrack(player.getVariantTracks().find((one) => one.height === height));
(async () => {
  await player.attach(video);
  player.configure({streaming: {lowLatencyMode: true}, abr: {enabled: false}});
  await player.load(MANIFEST);
  await video.play();
})().catch((error) => { window.failed = String(error.message ?? error); });
</script>"""


@pytest.fixture(scope="module")
def render(models: Path) -> Iterator[RenderServer]:
    with RenderServer("--scenes", str(models)) as running:
        yield running


@pytest.fixture(scope="module")
def packager(render: RenderServer) -> Iterator[Packager]:
    running = Packager()
    running.render = render.url.rstrip("/")
    with running:
        yield running


@pytest.fixture
def stream(packager: Packager) -> Iterator[str]:
    """The URL of a new stream, without the manifest's name; it has two representations."""
    wanted = session_request(
        scene="pebbles", position=[0, 0, 0], segment_s=1, representations=[{"rung": 2}, {"rung": 3}]
    )
    with urlopen(Request(f"{packager.url}/sessions", json.dumps(wanted).encode())) as answer:
        session: dict[str, Any] = json.load(answer)
    yield f"{packager.url}{session['manifest']}".removesuffix("manifest.mpd")
    urlopen(Request(f"{packager.url}/sessions/{session['id']}", method="DELETE")).close()


@contextmanager
def shaka_player(stream: str) -> Iterator[Page]:
    """A page that plays a stream in Shaka Player, which leaves the choice of the representation to the test."""
    prerequisites.CHROMIUM.require()
    NODE_MODULES.require()
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=CHROMIUM_ARGS)
        page = browser.new_page()
        page.set_default_timeout(60_000)
        # From the packager's own origin, as far as the browser knows.
        origin = stream.partition("/sessions")[0]
        html = PAGE.replace("MANIFEST", f"'{stream}manifest.mpd'")
        page.route(f"{origin}/player", lambda route: route.fulfill(body=html, content_type="text/html"))
        page.route(f"{origin}/shaka.js", lambda route: route.fulfill(path=SHAKA, content_type="text/javascript"))
        page.goto(f"{origin}/player")
        yield page
        browser.close()


def wait_for(page: Page, condition: str) -> dict[str, Any]:
    """The player's state once it is as wanted: an expression of `result`."""
    page.wait_for_function(f"() => {{ const result = window.result(); return result.failed || ({condition}); }}")
    result: dict[str, Any] = page.evaluate("window.result()")
    assert result["failed"] is None
    return result


@pytest.mark.extended
def test_shaka_player_plays_and_switches_between_representations(stream: str) -> None:
    with shaka_player(stream) as page:
        wait_for(page, "result.frames >= 10")
        for width, height in ((320, 180), (640, 360), (320, 180)):
            page.evaluate("window.choose", height)
            switched = wait_for(page, f"result.width === {width}")
            frames, time = switched["frames"] + 45, switched["time"] + 1
            assert wait_for(page, f"result.frames >= {frames} && result.time > {time}")["width"] == width


def test_plays_in_ffmpeg(stream: str) -> None:
    FFMPEG.require()  # PyAV's wheel reads no manifests
    command = f"ffmpeg -v error -i {stream}manifest.mpd -map 0:v:0 -frames:v 45 -f framemd5 -"
    done = subprocess.run(command.split(), capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    rows = [line.split(",") for line in done.stdout.splitlines() if not line.startswith("#")]
    assert len(rows) == 45
