"""The containers from a user's point of view: the page, the link, permissions, and failures."""

from __future__ import annotations

import statistics
import time

import pytest
from playwright.sync_api import Page, expect

from tests.compose.stack import SERVICES, Service, Stack, answers, docker, download_kbps, round_trips_ms, store
from tests.eventually import wait_until
from tests.experiments.store.conftest import plan, slug, upload
from tests.web.conftest import PATIENCE
from tests.web.modes import wait_for_stream
from tests.web.scenes import SMALL
from tests.web.stage import SCENE, frames, picture, stat, wait_for_frames, wait_until_settled

pytestmark = [pytest.mark.alone, pytest.mark.timeout(900)]

PAYLOAD = 1448 / 1514
"""The part of a full packet, as tc counts it, that TCP carries."""
NET_ADMIN = 1 << 12
LEAVE = "python -c 'import socket; socket.create_connection((\"192.0.2.1\", 80), 2)'"
"""Connects to an address outside, as far as routes allow."""


def walk(page: Page) -> None:
    """Open the scene over WebTransport."""
    page.goto(f"http://localhost:8080/{SCENE}")
    wait_for_frames(page)
    expect(page.locator(".stage")).to_have_attribute("data-transport", "webtransport-streams", timeout=PATIENCE)


def recovers(page: Page) -> None:
    """The page shows new frames over WebTransport without being loaded again."""
    expect(page.locator(".stage")).to_have_attribute("data-transport", "webtransport-streams", timeout=2 * PATIENCE)
    shown = frames(page)
    page.keyboard.down("ArrowRight")
    wait_for_frames(page, shown + 5)
    page.keyboard.up("ArrowRight")


def test_the_page_shows_frames_over_webtransport(stack: Stack, page: Page) -> None:
    walk(page)
    wait_until_settled(page)
    assert page.evaluate("isSecureContext")
    page.keyboard.press("p")  # opens the lab
    assert stat(page, "transport") == "WebTransport streams"
    assert picture(page).std() > 10, "the picture is blank"


def test_the_page_says_why_it_does_not_train_and_the_command_what_it_needs(stack: Stack, page: Page) -> None:
    walk(page)
    page.keyboard.press("p")  # opens the lab
    expect(page.locator(".scene-training")).to_contain_text("Pages may not change this service")
    expect(page.locator(".scene-training button")).to_have_count(0)
    said = stack.inside("render", "tigas enhance train courtyard --out /tmp/networks")
    assert said == "torch is not installed: pip install 'tigas[lab]'\n"


def test_the_same_walk_as_a_dash_stream(stack: Stack, page: Page) -> None:
    walk(page)
    page.evaluate("tigas.settings({ mode: 'dash' })")
    wait_for_stream(page, at_least=30)
    docker("kill", stack.container("dash-packager"))
    expect(page.locator(".stage-message")).to_contain_text("Trying again", timeout=PATIENCE)
    stack.up()
    wait_for_stream(page, at_least=30)


def test_experiments_survive_a_killed_store(stack: Stack) -> None:
    experiment = store("POST", "/experiments", plan("kept"))["id"]
    run = f"/experiments/{experiment}/runs/{slug()}"
    store("PUT", run, upload())
    row = store("POST", f"{run}/complete")
    assert b"<html" in store("GET", f"/experiments/{experiment}/report")
    docker("kill", stack.container("store"))
    stack.up()
    told = store("GET", f"/experiments/{experiment}")
    assert (told["name"], told["runs"]) == ("kept", [row])
    assert store("GET", "/movements")["movements"]
    assert store("GET", f"/experiments/{experiment}/zip").startswith(b"PK")
    store("DELETE", f"/experiments/{experiment}")


@pytest.mark.parametrize("down_kbps", [8_000, 3_000])
def test_the_link_has_the_rate_that_was_set(stack: Stack, down_kbps: int) -> None:
    stack.set_link(down_kbps=down_kbps, up_kbps=5_000)
    rates = [download_kbps(SMALL, 1920, 1080) for _ in range(2)]
    print(f"{down_kbps} kbit/s: {', '.join(f'{rate:.0f}' for rate in rates)} arrived")
    assert statistics.mean(rates) == pytest.approx(down_kbps * PAYLOAD, rel=0.1)


def test_the_round_trip_takes_twice_the_delay(stack: Stack) -> None:
    without = statistics.median(round_trips_ms(20))
    stack.set_link(down_kbps=50_000, up_kbps=20_000, delay_ms=50)
    delayed = statistics.median(round_trips_ms(20))
    print(f"{without:.1f} ms without delay, {delayed:.1f} ms with 50 ms a way ({stack.status()['backend']})")
    assert delayed - without == pytest.approx(100, abs=5)


def test_the_page_survives_a_killed_render_service(stack: Stack, page: Page) -> None:
    walk(page)
    docker("kill", stack.container("render"))
    expect(page.locator(".stage-message")).to_contain_text("Trying again", timeout=PATIENCE)
    stack.up()
    recovers(page)


def test_nothing_flows_without_the_shaper(stack: Stack, page: Page) -> None:
    walk(page)
    docker("kill", stack.container("shaper"))
    wait_until(lambda: not answers())
    shown = frames(page)
    page.keyboard.down("ArrowRight")
    page.wait_for_timeout(1500)
    page.keyboard.up("ArrowRight")
    assert frames(page) <= shown + 1, "frames flow unshaped"
    stack.up()
    wait_until(answers)
    recovers(page)


@pytest.mark.parametrize("service", SERVICES)
def test_a_service_that_ends_is_started_again(stack: Stack, service: Service) -> None:
    started = stack.inspect(service)["State"]["StartedAt"]
    stack.inside(service, "kill -TERM 1")
    wait_until(lambda: stack.inspect(service)["State"]["StartedAt"] > started)
    wait_until(answers, 60)


@pytest.mark.parametrize("service", SERVICES)
def test_stops_when_told_to(stack: Stack, page: Page, service: Service) -> None:
    walk(page)
    before = time.monotonic()
    stack.compose("stop", service)
    print(f"{service} stopped in {time.monotonic() - before:.1f} s")
    assert stack.inspect(service)["State"]["ExitCode"] == 0, "it had to be killed"


@pytest.mark.parametrize("service", SERVICES)
def test_a_container_may_do_only_what_it_must(stack: Stack, service: Service) -> None:
    status = dict(line.split(":\t", 1) for line in stack.inside(service, "cat /proc/1/status").splitlines())
    capabilities = int(status["CapEff"], 16) | int(status["CapPrm"], 16) | int(status["CapBnd"], 16)
    assert capabilities == (NET_ADMIN if service == "shaper" else 0)
    assert status["NoNewPrivs"] == "1"
    assert (status["Uid"].split()[0] == "0") == (service == "shaper")
    assert "Read-only file system" in stack.inside(service, "touch /opt/tigas/x")
    ports = stack.inspect(service)["NetworkSettings"]["Ports"]
    published = {port: {entry["HostIp"] for entry in entries} for port, entries in ports.items() if entries}
    if service != "shaper":
        assert published == {}
        assert "unreachable" in stack.inside(service, LEAVE)
    else:
        assert set(published) == {"8080/tcp", "8081/tcp", "8081/udp", "8091/tcp", "8443/tcp", "4433/udp", "8090/tcp"}
        assert published["8090/tcp"] == {"127.0.0.1"}
