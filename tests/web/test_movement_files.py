"""Sources of movement traces in the page: chosen, dropped, by keyboard, or from a store; and invalid files."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import unquote

import pytest
from playwright.sync_api import Page, expect

from tests.web.conftest import OpenPage
from tests.web.movements import Poses, choose, opened, press, turning_walk
from tests.web.server import RenderServer


@pytest.fixture
def visit(open_page: OpenPage, server: RenderServer) -> tuple[Page, Poses]:
    """A viewer with recorded requests, and open settings."""
    return opened(open_page, server.url)


def test_a_file_may_be_dropped_anywhere(visit: tuple[Page, Poses]) -> None:
    page, _ = visit
    press(page, "Close lab")
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
    assert names[:4] == ["Open a CSV file…", "Position in the movement", "Play", "Record"]
    box = page.locator(".movement").bounding_box()
    assert box is not None
    assert box["x"] >= 0
    assert box["x"] + box["width"] <= 390


@pytest.fixture
def store() -> Iterator[str]:
    """A store of movements with the page's interface; it has one, and lists another that was deleted."""
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
            """Silent."""

    with ThreadingHTTPServer(("127.0.0.1", 0), Store) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()


@pytest.fixture
def server_with_store(models: Path, store: str) -> Iterator[str]:
    """The page's URL, from a render service with this store."""
    services = {"TIGAS_RENDER_SERVICES": json.dumps({"store": store})}
    with RenderServer("--scenes", str(models), environment=services) as running:
        yield running.url


def test_the_stores_movements(server_with_store: str, open_page: OpenPage) -> None:
    page, poses = opened(open_page, server_with_store, expected_errors="404")
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
