"""`window.tigas` in a real browser: the pictures that it keeps are of the poses that it says."""

from __future__ import annotations

import asyncio
import io
from collections import Counter
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from itertools import pairwise
from typing import Any

import httpx
import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from playwright.async_api import Page

from tests.experiments.conftest import Services, running
from tests.web.stamping import STAMPING, TOLERANCE, heading, read_headings
from tigas_common.pose import Pose
from tigas_experiments.errors import RunFailed
from tigas_experiments.run.browser import SampleList, Viewer, launch_chromium
from tigas_experiments.wire.recording import Recording
from tigas_experiments.wire.run import RunPlan

pytestmark = pytest.mark.alone

AS_THEY_COME = {"reprojection": False, "prediction": "off", "refine": False, "webp": False}
"""Frames are shown as they come, and asked for where the camera is, once each."""
TURN = [
    {"t_ms": t, "position": [0, 0, 0], "quaternion": [0, np.sin(t / 4000), 0, np.cos(t / 4000)]}
    for t in range(0, 2500, 50)
]

STANDING = heading(Pose.from_euler(0, 0, 0, (0, 0, 0)))
"""Before the camera turns."""


@pytest.fixture(scope="module")
def services(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Services]:
    """Services with pictures that encode the camera's direction."""
    with running(tmp_path_factory.mktemp("models"), STAMPING) as found:
        yield found


def plan(**changes: float) -> RunPlan:
    fields = {"duration_ms": 2000, "capture_every_ms": 0, "sample_stride": 0, "download": False, "points": TURN}
    return RunPlan.model_validate(fields | changes, strict=False)


@asynccontextmanager
async def opened(url: str, script: str = "") -> AsyncIterator[tuple[Page, Viewer]]:
    """A page and its bridge; `script` runs before the page's own."""
    async with launch_chromium() as browser:
        page = await browser.new_page(viewport={"width": 640, "height": 360})
        await page.add_init_script(script)
        await page.goto(f"{url}#/scene/pebbles")
        await page.wait_for_function("() => window.tigas !== undefined")
        yield page, Viewer(page)


def recorded(url: str, settings: dict[str, Any]) -> tuple[Recording, list[float | None]]:
    """A run, and the headings that its pictures show."""

    async def run() -> tuple[Recording, list[float | None]]:
        async with opened(url) as (_, viewer):
            with pytest.raises(RunFailed):
                await viewer.prepare({"seed": -1}, TURN[0])
            await viewer.prepare({"seed": 7, **settings, **AS_THEY_COME, "hud": False, "sidebar": False}, TURN[0])
            recording = await viewer.record(plan(capture_every_ms=100), 30)
            pictures = [await viewer.capture(index) for index in range(len(recording.captures))]
            with pytest.raises(RunFailed, match="there is no picture 0"):
                await viewer.capture(0)
            return recording, read_headings(np.array([middle_row(png) for png in pictures], np.float64))

    return asyncio.run(run())


def middle_row(png: bytes) -> NDArray[np.uint8]:
    """The brightness of its pixels."""
    with Image.open(io.BytesIO(png)) as image:
        row: NDArray[np.uint8] = np.asarray(image.convert("L"))[image.height // 2]
        return row


@pytest.mark.parametrize(
    "settings",
    [{"mode": "stateless", "controller": "fixed", "profile": 2}, {"mode": "dash", "dashPreset": "tuned"}],
    ids=["stateless", "dash"],
)
def test_pictures_show_the_poses_that_they_are_said_to_show(services: Services, settings: dict[str, Any]) -> None:
    recording, numbers = recorded(services.url, settings)
    said = [capture.pose for capture in recording.captures]
    assert len(said) == 20, "one for each tick of the clock"
    first = recording.inputs[0].pose
    headings = {one.pose: heading(one.camera) for one in recording.inputs if not one.missed}

    def expected(pose: int) -> float:
        """Heading of a pose; those before the run stand, and on a busy machine they are shown for its first ticks."""
        return headings[pose] if pose >= first else STANDING

    following = {a.pose: b.pose for a, b in pairwise(recording.frames)}
    early = 0
    for pose, number in zip(said, numbers, strict=True):
        assert number is not None
        # A busy browser skips reports of video frames, and may report a frame just before it shows it.
        last = expected(following.get(pose, pose))
        assert number <= last + TOLERANCE, "a picture is of its frame, or of one before the next"
        early += number < expected(pose) - TOLERANCE
        if settings["mode"] == "stateless":
            assert number == pytest.approx(expected(pose), abs=TOLERANCE)
    assert early <= 1
    if settings["mode"] == "stateless":
        check_replies(recording)
    else:
        assert (recording.replies, recording.requests) == ((), ())


def test_a_stalled_page_owes_the_poses_that_it_did_not_sample(services: Services) -> None:
    """Its script stands for 400 ms while the camera turns: in each frame of the display, a pose was due."""
    stall = "() => setTimeout(() => { for (const end = performance.now() + 400; performance.now() < end;); }, 700)"

    async def run() -> Recording:
        async with opened(services.url) as (page, viewer):
            await viewer.prepare({"mode": "stateless", "controller": "fixed", "profile": 2, **AS_THEY_COME}, TURN[0])
            await page.evaluate(stall)
            return await viewer.record(plan(capture_every_ms=100), 30)

    recording = asyncio.run(run())
    interval = recording.display_interval_ms
    assert interval is not None
    missed = [entry for entry in recording.inputs if entry.missed]
    longest = max(later.at - earlier.at for earlier, later in pairwise(recording.inputs))
    assert len(missed) * interval > 300
    assert longest < 2 * interval, "no time in which the camera turned is without inputs"
    assert len(recording.captures) == 20, "a tick that fell into the stall counts, too"


def test_every_third_shown_frame_is_sampled_as_it_came(services: Services) -> None:
    async def run() -> tuple[Recording, SampleList, dict[str, bytes]]:
        async with opened(services.url) as (_, viewer):
            await viewer.prepare({"mode": "stateless", "controller": "fixed", "profile": 2, **AS_THEY_COME}, TURN[0])
            recording = await viewer.record(plan(sample_stride=3), 30)
            told = await viewer.samples()
            return recording, told, {name: await viewer.sample_picture(name) for name in told.pictures}

    recording, told, pictures = asyncio.run(run())
    assert told.problem is None
    assert list(pictures) == [f"{sample.seq:06}.jpg" for sample in told.samples]
    assert [sample.at for sample in told.samples] == [frame.at for frame in recording.frames][::3]
    for sample in told.samples[::4]:
        jpeg = pictures[f"{sample.seq:06}.jpg"]
        assert (sample.rung, sample.bytes) == (2, len(jpeg))
        answer = httpx.post(f"{services.url}render", content=sample.request.model_dump_json(exclude_none=True))
        assert answer.content == jpeg, "the same request has another answer"
        with Image.open(io.BytesIO(jpeg)) as image:
            assert image.size == (sample.width, sample.height)


REFUSED = "navigator.storage.getDirectory = () => Promise.reject(new DOMException('', 'SecurityError'))"


def test_a_run_goes_on_where_the_browser_keeps_no_files(services: Services) -> None:
    async def run() -> tuple[Recording, SampleList]:
        async with opened(services.url, script=REFUSED) as (_, viewer):
            await viewer.prepare({"mode": "stateless", "controller": "fixed", "profile": 3, **AS_THEY_COME}, TURN[0])
            return await viewer.record(plan(sample_stride=3, duration_ms=1000), 30), await viewer.samples()

    recording, told = asyncio.run(run())
    assert recording.complete
    assert (told.samples, told.pictures) == ((), ())
    assert told.problem == (
        "The browser stores no files for this page, as in a private window or without HTTPS. Nothing was sampled."
    )


def check_replies(recording: Recording) -> None:
    """Every frame that was shown had come before, of the rung that was asked for."""
    came = {reply.pose: reply for reply in recording.replies}
    shown = [frame for frame in recording.frames if frame.pose >= recording.inputs[0].pose]
    assert len(shown) > 10
    for frame in shown:
        reply = came[frame.pose]
        assert (reply.asked_rung, reply.rung) == (2, frame.rung)
        assert reply.asked_at < reply.first_byte_at <= reply.at < frame.at
        assert reply.server is not None
        assert 0 < reply.server.render < reply.time_ms
    assert recording.replies[-1].throughput_kbps
    fates = Counter(request.fate for request in recording.requests)
    assert fates["shown"] == len(shown)
    answered = [reply for reply in recording.replies if reply.asked_at >= 0]
    assert fates["shown"] + fates["overtaken"] <= len(answered) <= len(recording.requests)
