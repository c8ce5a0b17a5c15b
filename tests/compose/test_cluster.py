"""A cluster in containers, from a viewer's point of view: the rendering host, and its failure."""

from __future__ import annotations

import json
import time
from typing import Any, cast

import httpx
import pytest
from playwright.sync_api import Page, expect

from tests.compose.stack import MACHINES, Machine, Stack, docker
from tests.eventually import wait_until
from tests.web.conftest import PATIENCE
from tests.web.stage import SCENE, frames, wait_for_frames

pytestmark = [pytest.mark.alone, pytest.mark.timeout(900)]

ADDRESSES: dict[Machine, str] = {"host-1": "127.0.0.11", "host-2": "127.0.0.12"}
WATCH = """() => {
  const stage = document.querySelector(".stage");
  window.longest = 0;
  let [last, shown] = [performance.now(), stage.dataset.frames];
  const watch = () => {
    const now = performance.now();
    window.longest = Math.max(window.longest, now - last);
    if (stage.dataset.frames !== shown) [last, shown] = [now, stage.dataset.frames];
    requestAnimationFrame(watch);
  };
  watch();
}"""
"""From now on, notes in `longest` how many milliseconds the page went without a new frame."""


def load(host: Machine) -> dict[str, Any] | None:
    """How busy a host is; None if it does not answer."""
    try:
        answer = httpx.get(f"http://{ADDRESSES[host]}:8080/api/load", timeout=2)
        return cast(dict[str, Any], answer.raise_for_status().json())
    except httpx.HTTPError:
        return None


def serving() -> list[Machine]:
    """The hosts that have a viewer."""
    return [host for host in ADDRESSES if (load(host) or {"viewers": 0})["viewers"] > 0]


def others(host: Machine) -> Machine:
    """The other host."""
    (other,) = ADDRESSES.keys() - {host}
    return other


def status(cluster: Stack) -> list[dict[str, Any]]:
    """Output of `tigas cluster status`, from the head."""
    return cast(list[dict[str, Any]], json.loads(cluster.inside("head", "tigas cluster status --json")))


def directors(cluster: Stack) -> list[str]:
    """The ids of the processes that are `tigas cluster up`."""
    named = "tr '\\0' ' ' < $each/cmdline | grep -q 'tigas cluster u[p]'"
    return cluster.inside("head", f"for each in /proc/[0-9]*; do {named} && echo ${{each#/proc/}}; done").split()


def page_answers() -> bool:
    """Whether the director answers."""
    try:
        return httpx.get("http://localhost:8080/healthz", timeout=2).status_code == 200
    except httpx.HTTPError:
        return False


@pytest.fixture
def walking(cluster: Stack, page: Page) -> Page:
    """A page that turns without end, over WebTransport, in a cluster that is whole."""
    cluster.up()
    wait_until(lambda: all(load(host) is not None for host in ADDRESSES), 120)
    page.goto(f"http://localhost:8080/{SCENE}")
    wait_for_frames(page)
    expect(page.locator(".stage")).to_have_attribute("data-transport", "webtransport-streams", timeout=PATIENCE)
    page.keyboard.down("ArrowRight")
    wait_for_frames(page, frames(page) + 10)
    return page


def test_a_viewer_whose_host_is_killed_goes_on_within_two_seconds(cluster: Stack, walking: Page) -> None:
    (host,) = serving()
    walking.evaluate(WATCH)
    docker("kill", cluster.container(host))
    walking.wait_for_timeout(5000)
    longest = walking.evaluate("longest")
    print(f"{longest:.0f} ms without a frame after {host} was killed")
    assert serving() == [others(host)]
    assert longest < 2000
    expect(walking.locator(".stage")).to_have_attribute("data-transport", "webtransport-streams", timeout=PATIENCE)


def test_hosts_and_viewers_outlive_the_director(cluster: Stack, walking: Page) -> None:
    before = sorted(host["since"] for host in status(cluster))
    wait_until(lambda: len(directors(cluster)) == 1)  # a process that it starts has its name for a moment
    (killed,) = directors(cluster)
    cluster.inside("head", f"kill -KILL {killed}")
    wait_for_frames(walking, frames(walking) + 20)
    wait_until(lambda: directors(cluster) not in ([], [killed]), 60)
    wait_until(page_answers, 60)
    assert sorted(host["since"] for host in status(cluster)) == before


@pytest.mark.parametrize("machine", MACHINES)
def test_a_machine_may_do_only_what_it_must(cluster: Stack, machine: Machine) -> None:
    cluster.up()
    processes = cluster.inside(machine, "cat /proc/[0-9]*/status").split("Name:\t")[1:]
    told = [dict(line.split(":\t", 1) for line in each.splitlines() if ":\t" in line) for each in processes]
    assert len(told) > 3
    assert {each["Uid"].split()[0] for each in told} == {"10001"}
    assert {each["CapEff"] + each["CapPrm"] + each["CapBnd"] for each in told} == {"0" * 48}
    assert {each["NoNewPrivs"] for each in told} == {"1"}
    assert "Read-only file system" in cluster.inside(machine, "touch /opt/tigas/x")


def test_only_pages_and_frames_are_published(cluster: Stack) -> None:
    published = {
        machine: {
            (port, entry["HostIp"])
            for port, entries in cluster.inspect(machine)["NetworkSettings"]["Ports"].items()
            for entry in entries or ()
        }
        for machine in MACHINES
    }
    assert published["head"] == {("8080/tcp", "127.0.0.1")}
    for host, address in ADDRESSES.items():
        assert published[host] == {("8080/tcp", address), ("4433/udp", address)}


def test_it_stops_when_told_to(cluster: Stack) -> None:
    cluster.up()
    before = time.monotonic()
    cluster.compose("stop")
    print(f"stopped in {time.monotonic() - before:.1f} s")
    codes = {machine: cluster.inspect(machine)["State"]["ExitCode"] for machine in MACHINES}
    assert codes["head"] == 0
    assert 137 not in codes.values(), "something had to be killed"
