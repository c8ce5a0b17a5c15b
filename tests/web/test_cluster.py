"""The page before a director and two hosts, one of which lets it down."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from tests.cluster.director_in_thread import RunningDirector, running_director
from tests.prerequisites import BUILT_PAGE
from tests.web.conftest import OpenPage
from tests.web.server import RenderServer
from tests.web.stage import SCENE, stat, wait_for_frames
from tigas_cluster import fleet
from tigas_cluster.fleet import HostAddress

WATCH = """() => {
  const stage = document.querySelector(".stage");
  window.phases = [];
  const note = () => window.phases.push(stage.dataset.phase);
  new MutationObserver(note).observe(stage, { attributeFilter: ["data-phase"] });
}"""
"""Notes every phase that follows, in the page. When it asks its director is up to its own clock, which
`connection.test.ts` replaces: how long frames take to come back depends on how busy the machine is that runs this.
"""
SHOWS = """(host) => {
  const shown = Number(document.querySelector(".stage").dataset.frames);
  if (document.querySelector("[data-stat=host]")?.textContent !== host) window.shownBefore = undefined;
  else window.shownBefore ??= shown;
  return shown > window.shownBefore;
}"""
"""Whether frames have been shown since the page has been at a host."""


@dataclass
class Cluster:
    """A director and its hosts, by name."""

    director: RunningDirector
    hosts: dict[str, RenderServer]

    def other(self, name: str) -> str:
        [other] = self.hosts.keys() - {name}
        return other

    def drain(self, *names: str) -> None:
        """These are to end, and no others."""
        self.director.follow(
            HostAddress(name, host.url.rstrip("/"), draining=name in names) for name, host in self.hosts.items()
        )


@pytest.fixture(scope="module")
def hosts(models: Path) -> Iterator[dict[str, RenderServer]]:
    """Two that make frames up, so that nothing but the page takes time."""
    BUILT_PAGE.require()
    with ExitStack() as stack:
        arguments = ("--scenes", str(models), "--device", "instant:5000", "--edges", "1")
        yield {name: stack.enter_context(RenderServer(*arguments)) for name in ("east", "west")}


@pytest.fixture
def cluster(hosts: dict[str, RenderServer], monkeypatch: pytest.MonkeyPatch) -> Iterator[Cluster]:
    """Both hosts are up at first; one that is only slow, on a busy machine, stays so."""
    monkeypatch.setattr(fleet, "DOWN_AFTER_S", 10.0)
    with running_director([HostAddress(name, host.url.rstrip("/")) for name, host in hosts.items()]) as director:
        director.wait_for(hosts)
        yield Cluster(director, hosts)


@pytest.fixture
def page(cluster: Cluster, open_page: OpenPage) -> Page:
    """Turns all the time, so that frames are always wanted."""
    # on a busy machine, hosts are silent for a second, and none is up
    page = open_page(SCENE, url=cluster.director.url, expected_errors="ERR_|503")
    wait_for_frames(page)
    page.keyboard.down("ArrowRight")
    wait_for_frames(page, 2)
    # a loss within the first second of a connection is reported at once
    page.wait_for_function("(since) => performance.now() > since + 1000", arg=page.evaluate("performance.now()"))
    return page


@contextmanager
def killed(host: RenderServer) -> Iterator[None]:
    """Until the context ends, when it is started again."""
    host.kill()
    try:
        yield
    finally:
        host.start()


def goes_on_elsewhere(page: Page, cluster: Cluster, name: str) -> None:
    """Wait until the other host's frames are shown, without a word about a lost connection in between."""
    page.wait_for_function(SHOWS, arg=cluster.other(name))
    expect(page.locator(".stage")).to_have_attribute("data-phase", "playing")
    expect(page.locator(".stage")).to_have_attribute("data-transport", "webtransport-streams")
    assert page.evaluate("window.phases") == [], "the viewer was told that the server is gone"
    page.keyboard.up("ArrowRight")


@pytest.mark.parametrize(
    "let_down",
    [pytest.param(killed, id="killed"), pytest.param(RenderServer.held, id="stopped", marks=pytest.mark.extended)],
)
def test_a_viewer_of_a_host_that_is_gone_is_sent_elsewhere_by_the_director(
    cluster: Cluster, page: Page, let_down: Callable[[RenderServer], AbstractContextManager[None]]
) -> None:
    name = stat(page, "host")
    page.evaluate(WATCH)
    with let_down(cluster.hosts[name]):
        goes_on_elsewhere(page, cluster, name)


def test_a_viewer_of_a_draining_host_goes_elsewhere_without_an_interruption(cluster: Cluster, page: Page) -> None:
    name = stat(page, "host")
    page.evaluate(WATCH)
    cluster.drain(name)
    goes_on_elsewhere(page, cluster, name)


def test_a_scene_is_downloaded_from_its_host(cluster: Cluster, page: Page) -> None:
    page.keyboard.up("ArrowRight")
    host = cluster.hosts[stat(page, "host")].url
    with page.expect_response(lambda response: "/download/" in response.url) as download:
        page.evaluate("tigas.settings({ mode: 'local' })")
    assert download.value.ok
    assert download.value.url.startswith(host)
    expect(page.locator("[data-stat=downloaded]")).to_contain_text("B")
    page.evaluate("tigas.settings({ mode: 'stateless' })")
