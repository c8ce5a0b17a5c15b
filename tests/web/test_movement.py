"""Movement traces in the page: the camera follows a file, a recording is what was seen, and the person takes over."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
import pytest
from numpy.typing import NDArray
from playwright.sync_api import Page, Request, Route, expect

from tests.web.conftest import PATIENCE, OpenPage
from tests.web.modes import with_settings
from tests.web.server import RenderServer
from tests.web.stage import SCENE, frames, wait_for_frames, wait_until_settled
from tigas_lab.movement.trace import MovementTrace

HEADER = "t_ms,x,y,z,qx,qy,qz,qw\n"
WALK = {"viewport": {"width": 1000, "height": 1100}}
MICRO = 5e-6
"""The page rounds a person's poses to a millionth, and files are written to a millionth."""


def file(name: str, content: str | bytes) -> Any:
    """A file as a person chooses it."""
    return {"name": name, "mimeType": "text/csv", "buffer": content if isinstance(content, bytes) else content.encode()}


def turning_walk(duration_ms: int, *, name: str = "walk.csv") -> Any:
    """Along x, to 1 and quicker at first, while it turns to the right by an angle of x."""
    rows = []
    for t in range(0, duration_ms + 1, 25):
        x = np.sqrt(t / duration_ms)
        rows.append(f"{t},{x},0,0,0,{np.sin(x / 2)},0,{np.cos(x / 2)}\n")
    return file(name, f"# anchor: scene\n# description: A walk along x\n{HEADER}{''.join(rows)}")


class Poses:
    """Where the camera was, by what the page asked to be rendered: positions and quaternions, in order."""

    def __init__(self, page: Page) -> None:
        self._asked: list[dict[str, Any]] = []
        page.on("request", self._on_request)

    def clear(self) -> None:
        """Forget them."""
        self._asked.clear()

    def __len__(self) -> int:
        return len(self._asked)

    @property
    def positions(self) -> NDArray[np.float64]:
        """[N, 3]"""
        return np.array([one["position"] for one in self._asked])

    @property
    def quaternions(self) -> NDArray[np.float64]:
        """[N, 4]"""
        return np.array([one["quaternion"] for one in self._asked])

    def _on_request(self, request: Request) -> None:
        if request.url.endswith("/render"):
            self._asked.append(json.loads(request.post_data or ""))


@pytest.fixture
def visit(open_page: OpenPage, server: RenderServer) -> tuple[Page, Poses]:
    """A viewer whose requests can be watched, and whose settings are open."""
    return opened(open_page, server.url)


def opened(open_page: OpenPage, url: str, **options: Any) -> tuple[Page, Poses]:
    chosen = with_settings(url, transport="fetch", controller="fixed", profile=3, refine=False, sidebar=True)
    page = open_page(SCENE, url=url, **{**WALK, **chosen, **options})
    poses = Poses(page)
    wait_for_frames(page)
    return page, poses


def choose(page: Page, chosen: Any) -> None:
    page.get_by_label("Movement file", exact=True).set_input_files(chosen)


def press(page: Page, name: str) -> None:
    page.get_by_role("button", name=name, exact=True).click()


def expect_state(page: Page, state: str) -> None:
    expect(page.locator("[data-movement]")).to_have_attribute("data-movement", state)


def wait_for_pose(page: Page, poses: Poses, position: tuple[float, float, float]) -> None:
    """Until the camera stands there, to what a movement's chords differ from its curve."""
    deadline = time.monotonic() + PATIENCE / 1000
    while np.abs(poses.positions[-1] - position).max() > 1e-4:
        assert time.monotonic() < deadline, f"the camera is at {poses.positions[-1]}"
        page.wait_for_timeout(20)


def assert_on_the_walk(poses: Poses) -> None:
    """All poses are those of `turning_walk`."""
    x = poses.positions[:, 0]
    np.testing.assert_allclose(poses.positions[:, 1:], 0, atol=MICRO)
    zero = np.zeros_like(x)
    expected = np.column_stack((zero, np.sin(x / 2), zero, np.cos(x / 2)))
    np.testing.assert_allclose(poses.quaternions, expected, atol=MICRO)


def test_the_camera_follows_a_file_and_the_person_goes_on_from_its_end(visit: tuple[Page, Poses]) -> None:
    page, poses = visit
    choose(page, turning_walk(1500))
    expect(page.get_by_role("radio", name="walk.csv")).to_be_checked()
    expect(page.locator(".movement")).to_contain_text("A walk along x")
    poses.clear()
    press(page, "Play")
    expect(page.locator(".movement-status")).to_contain_text("Your input waits")
    page.locator(".stage").focus()
    page.keyboard.press("KeyA", delay=300)
    expect_state(page, "stopped")
    wait_until_settled(page)
    expect(page.locator(".movement-status")).to_have_count(0)
    expect(page.locator(".movement-progress output")).to_have_text("0:01 / 0:01")
    assert len(poses) > 10
    assert_on_the_walk(poses)
    assert (np.diff(poses.positions[:, 0]) >= -MICRO).all()
    assert poses.positions[-1] == pytest.approx((1, 0, 0), abs=MICRO)

    poses.clear()
    page.locator(".stage").focus()
    page.keyboard.press("KeyD", delay=300)
    wait_until_settled(page)
    ahead = poses.positions - (1, 0, 0)
    assert np.linalg.norm(ahead[0]) < 0.5, "the camera jumped"
    assert ahead[-1] @ (np.cos(1), 0, -np.sin(1)) > 0.1, "to the right of where the walk had turned to"


def test_whoever_stops_a_movement_has_the_camera_where_it_is(visit: tuple[Page, Poses]) -> None:
    page, poses = visit
    choose(page, turning_walk(60_000))

    def close_settings_and_stop() -> None:
        press(page, "Close settings")
        press(page, "Stop the movement")
        press(page, "Settings")

    ways: list[Callable[[], None]] = [
        lambda: page.keyboard.press("Escape"),
        lambda: press(page, "Stop"),
        close_settings_and_stop,
    ]
    for stop in ways:
        press(page, "Play")
        page.wait_for_timeout(300)
        stop()
        expect_state(page, "stopped")
        wait_until_settled(page)
        expect(page.locator(".movement-status")).to_have_count(0)
        stood = poses.positions[-1]
        assert 0 < stood[0] < 0.9
        poses.clear()
        page.locator(".stage").focus()
        page.keyboard.press("ArrowRight", delay=200)
        wait_until_settled(page)
        assert poses.positions == pytest.approx(np.tile(stood, (len(poses), 1)), abs=1e-3), "turning is no walking"
        assert poses.quaternions[-1, 1] > poses.quaternions[0, 1]


def test_paused_and_sought(visit: tuple[Page, Poses]) -> None:
    page, poses = visit
    choose(page, turning_walk(60_000))
    slider = page.get_by_role("slider", name="Place in the movement")
    slider.fill("50")
    expect_state(page, "paused")
    expect(slider).to_have_attribute("aria-valuetext", "0:15 of 1:00")
    wait_for_pose(page, poses, (0.5, 0, 0))
    slider.press("ArrowRight")
    wait_for_pose(page, poses, (np.sqrt(51 / 200), 0, 0))
    sought = poses.positions[-1]
    page.locator(".stage").focus()
    page.keyboard.press("KeyW", delay=200)
    assert poses.positions[-1] == pytest.approx(sought), "input waits"
    press(page, "Resume")
    page.wait_for_function("() => document.querySelector('.movement-progress output').value.startsWith('0:16')")
    press(page, "Pause")
    wait_until_settled(page)
    assert poses.positions[-1, 0] > sought[0]


def test_a_recording_replays_what_was_seen(open_page: OpenPage, server: RenderServer, tmp_path: Path) -> None:
    page, poses = opened(open_page, server.url)
    poses.clear()
    press(page, "Record")
    expect(page.locator(".movement-status")).to_contain_text("Recording")
    page.locator(".stage").focus()
    page.keyboard.down("KeyW")
    page.keyboard.press("ArrowRight", delay=400)
    page.keyboard.up("KeyW")
    page.wait_for_timeout(300)
    page.keyboard.press("ArrowUp", delay=200)
    wait_until_settled(page)
    press(page, "Stop recording")
    expect(page.get_by_role("radio", name="Recording 1")).to_be_checked()
    expect(page.locator(".movement")).to_contain_text("not saved yet")
    with page.expect_download() as downloading:
        page.get_by_role("button", name="Save as CSV").click()
    expect(page.locator(".movement")).not_to_contain_text("not saved yet")
    assert downloading.value.suggested_filename.startswith("movement-pebbles-20")
    path = tmp_path / "recorded.csv"
    downloading.value.save_as(path)

    trace = MovementTrace.read(path)
    assert (trace.anchor, trace.comments["scene"]) == ("scene", "pebbles")
    assert trace.duration_ms > 900
    kept = np.hstack((trace.positions, trace.quaternions))
    seen = np.hstack((poses.positions, poses.quaternions))
    assert len(seen) > 10
    assert distances(seen, kept).max() < MICRO, "every view that was seen is in the file"

    again, replayed = opened(open_page, server.url)
    choose(again, path)
    replayed.clear()
    press(again, "Play")
    expect_state(again, "playing")
    expect_state(again, "stopped")
    wait_until_settled(again)
    dense = np.hstack(trace.poses_at(np.arange(0, trace.duration_ms + 1)))
    shown = np.hstack((replayed.positions, replayed.quaternions))
    assert len(shown) > 10
    assert distances(shown, dense).max() < 2e-3, "between two recorded poses it goes straight"
    assert shown[-1] == pytest.approx(kept[-1], abs=MICRO)


def distances(these: NDArray[np.float64], those: NDArray[np.float64]) -> NDArray[np.float64]:
    """How far each of these is from the nearest of those."""
    nearest: NDArray[np.float64] = np.linalg.norm(these[:, None] - those[None], axis=2).min(axis=1)
    return nearest


def test_a_file_that_is_no_movement_changes_nothing(visit: tuple[Page, Poses]) -> None:
    page, poses = visit
    hostile: dict[str | bytes, str] = {
        f"{HEADER}0,1,2,nan,0,0,0,1\n": "hostile.csv, line 2: the row needs a number as z.",
        b"PK\x03\x04\x00\x00\xff\xfe": "hostile.csv is binary, not the text of a movement.",
        "": "hostile.csv is empty.",
        "<html><script>alert(1)</script>": "hostile.csv has no column “t_ms”; it needs",
    }
    choose(page, turning_walk(60_000))
    press(page, "Play")
    expect_state(page, "playing")
    for content, sentence in hostile.items():
        choose(page, file("hostile.csv", content))
        expect(page.locator(".movement").get_by_role("alert")).to_contain_text(sentence)
        expect_state(page, "playing")
        expect(page.locator(".movement").get_by_role("radio")).to_have_count(1)
    moved = len(poses)
    wait_for_frames(page, frames(page) + 5)
    assert len(poses) > moved
    choose(page, turning_walk(60_000, name="other.csv"))
    expect(page.get_by_role("radio", name="other.csv")).to_be_checked()
    expect(page.locator(".movement").get_by_role("alert")).to_have_count(0)


def test_a_file_may_be_dropped_anywhere(visit: tuple[Page, Poses]) -> None:
    page, _ = visit
    press(page, "Close settings")
    text = turning_walk(1000)["buffer"].decode()
    dropped = page.evaluate_handle(
        """text => {
          const data = new DataTransfer();
          data.items.add(new File([text], "dropped.csv"));
          return data;
        }""",
        text,
    )
    page.dispatch_event(".stage", "drop", {"dataTransfer": dropped})
    expect(page.get_by_role("radio", name="dropped.csv")).to_be_checked()


def test_everything_is_reached_by_keyboard_on_a_phone(open_page: OpenPage, server: RenderServer) -> None:
    page, _ = opened(open_page, server.url, viewport={"width": 390, "height": 844})
    choose(page, turning_walk(60_000))
    expect(page.get_by_role("radio", name="walk.csv")).to_be_checked()
    page.get_by_role("radio", name="walk.csv").focus()
    names = []
    for _ in range(7):
        page.keyboard.press("Tab")
        names.append(page.evaluate("(document.activeElement.ariaLabel ?? document.activeElement.innerText).trim()"))
    assert names[:4] == ["Open a CSV file…", "Place in the movement", "Play", "Record"]
    box = page.locator(".movement").bounding_box()
    assert box is not None
    assert box["x"] >= 0
    assert box["x"] + box["width"] <= 390


@pytest.fixture
def store() -> Iterator[str]:
    """A store of movements as the page asks it; it keeps one, and lists one more that is gone."""
    listed = [
        {"name": "walk 1", "duration_ms": 60_000, "anchor": "scene", "description": "A walk along x"},
        {"name": "gone", "duration_ms": 1000, "anchor": "start", "description": ""},
    ]
    walk: bytes = turning_walk(60_000)["buffer"]

    class Store(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            path = unquote(self.path)
            problem = {"type": "tigas:unknown-movement", "title": "", "status": 404, "detail": "It was deleted."}
            answers: dict[str, tuple[int, bytes]] = {
                "/movements": (200, json.dumps({"movements": listed}).encode()),
                "/movements/walk 1": (200, walk),
            }
            status, body = answers.get(path, (404, json.dumps(problem).encode()))
            self.send_response(status)
            self.send_header("Access-Control-Allow-Origin", "*")
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, format: str, *args: object) -> None:
            """Says nothing."""

    with ThreadingHTTPServer(("127.0.0.1", 0), Store) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()


def test_the_stores_movements(open_page: OpenPage, server: RenderServer, store: str) -> None:
    page, poses = opened(open_page, server.url, expected_errors="404")

    def add_store(route: Route) -> None:
        answer = route.fetch()
        route.fulfill(response=answer, json=answer.json() | {"services": {"store": store}})

    page.route("**/config.json", add_store)
    page.reload()
    walk, gone = (page.get_by_role("radio", name=name) for name in ("walk 1", "gone"))
    walk.check()
    expect(page.locator(".movement")).to_contain_text("A walk along x")
    gone.click()  # it does not stay checked
    expect(page.locator(".movement").get_by_role("alert")).to_have_text("It was deleted.")
    expect(walk).to_be_checked()
    poses.clear()
    press(page, "Play")
    page.wait_for_function("() => document.querySelector('.movement-progress output').value.startsWith('0:01')")
    press(page, "Stop")
    assert poses.positions[-1, 0] > 0.1
