"""Failures of the network or the server, from the page's point of view."""

from __future__ import annotations

import json
import socket
import time

import pytest
from playwright.sync_api import Route, expect

from tests.web.conftest import OpenPage
from tests.web.server import RenderServer
from tests.web.stage import SCENE, changes, frames, hold, picture, wait_for_frames, wait_until_settled

pytestmark = pytest.mark.alone

WITHIN_S = 20
"""For a busy machine; a connection without answers times out after 30 s."""


def test_falls_back_to_fetch_where_quic_does_not_get_through(open_page: OpenPage) -> None:
    page = open_page(expected_errors="ERR_QUIC")

    def without_quic(route: Route) -> None:
        config = route.fetch().json()
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as silent:
            silent.bind(("127.0.0.1", 0))
            config["webtransport_url"] = f"https://127.0.0.1:{silent.getsockname()[1]}/render"
        route.fulfill(body=json.dumps(config), content_type="application/json")

    page.route("**/config.json?*", without_quic)
    page.get_by_role("link", name="Pebbles").click()
    expect(page.locator("[data-stat=transport]")).to_have_text("HTTP fetch")
    expect(page.locator("[data-stat=fallback]")).to_contain_text("QUIC")
    wait_for_frames(page)
    wait_until_settled(page)
    assert changes(page, lambda: hold(page, "ArrowRight")) > 1


def test_a_page_over_plain_http_works_and_names_the_secure_one(open_page: OpenPage, server: RenderServer) -> None:
    def from_another_device(route: Route) -> None:
        path = route.request.url.removeprefix("http://tigas.example/")
        headers = {name: value for name, value in route.request.headers.items() if name != "origin"}
        answer = route.fetch(url=server.url + path, headers=headers)  # as from the server's own page
        if path.startswith("config.json"):
            route.fulfill(json=answer.json() | {"https_url": "https://tigas.example:8443/"})
        else:
            route.fulfill(response=answer)

    page = open_page(expected_errors="ERR_")  # requests after the end of the test
    page.route("http://tigas.example/**", from_another_device)
    page.goto("http://tigas.example/")
    expect(page.get_by_role("link", name="the secure page")).to_have_attribute("href", "https://tigas.example:8443/")
    page.get_by_role("link", name="Pebbles").click()
    expect(page.locator("[data-stat=fallback]")).to_contain_text("secure context")
    wait_for_frames(page)
    assert picture(page).std() > 10, "the picture is blank"


def test_a_lost_server_is_announced_and_found_again_within_seconds(open_page: OpenPage, server: RenderServer) -> None:
    page = open_page(SCENE, expected_errors="ERR_")
    wait_for_frames(page)
    page.keyboard.down("ArrowRight")
    server.kill()
    expect(page.locator(".stage-message")).to_contain_text("Trying again")
    assert picture(page).std() > 5, "the last frame stays"
    server.start()  # at the same address, with a new certificate
    shown, started = frames(page), time.monotonic()
    wait_for_frames(page, shown + 5)
    assert time.monotonic() - started < WITHIN_S
    page.keyboard.up("ArrowRight")
    wait_until_settled(page)
    expect(page.locator(".stage-message")).to_have_text("")
    expect(page.locator(".stage")).to_have_attribute("data-transport", "webtransport-streams")
