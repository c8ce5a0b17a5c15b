"""The director's answers, over made-up hosts."""

from __future__ import annotations

from collections.abc import AsyncIterator

import httpx
import pytest

from tests.cluster.hosts import FakeFleet, asking_director, host
from tests.prometheus import figures
from tests.render.fakes import render_request
from tigas_common.placement import rank_names

pytestmark = pytest.mark.anyio

FIRST, SECOND = rank_names("garden", ("a", "b"))


@pytest.fixture
def fleet() -> FakeFleet:
    return FakeFleet(host("a"), host("b"))


@pytest.fixture
async def client(fleet: FakeFleet) -> AsyncIterator[httpx.AsyncClient]:
    services = {"dash": ":8081", "store": "http://store.test:8091"}
    async with asking_director(fleet, services=services) as client:
        yield client


async def served_by(client: httpx.AsyncClient, **viewer: str) -> str:
    answer = await client.get("/config.json", params={"scene": "garden", **viewer})
    assert answer.status_code == 200, answer.text
    return str(answer.json()["host"])


async def test_a_page_hears_where_its_scene_is_and_what_is_the_directors_own(client: httpx.AsyncClient) -> None:
    config = (await client.get("/config.json?scene=garden")).json()
    assert config["host"] == FIRST
    assert config["render_url"] == f"http://{FIRST}.test:8080"
    assert (config["webtransport_url"], config["certificate_sha256"]) == ("https://192.0.2.1:4433/render", "AQID")
    assert config["retry_after_s"] is None
    assert config["https_url"] is None
    assert config["services"] == {"dash": "http://localhost:8081", "store": "http://store.test:8091"}
    assert config["max_upload_bytes"] is None, "what one host keeps, the others lack"


async def test_a_viewer_stays_where_it_is_while_that_is_well(client: httpx.AsyncClient, fleet: FakeFleet) -> None:
    assert await served_by(client, at=SECOND) == SECOND
    assert fleet.suspected == []
    fleet.states = [host("a", draining=True), host("b")]
    assert await served_by(client, at="a") == "b"


async def test_a_viewer_leaves_a_silent_host(client: httpx.AsyncClient, fleet: FakeFleet) -> None:
    assert await served_by(client, silent=SECOND) == SECOND
    assert fleet.suspected == [SECOND]
    fleet.dead = {SECOND}
    assert await served_by(client, silent=SECOND) == FIRST
    fleet.dead, fleet.states = set(), [host(FIRST, full=5.0), host(SECOND)]
    assert await served_by(client, silent=FIRST) == SECOND
    assert await served_by(client, at=FIRST) == FIRST


async def test_a_viewer_that_could_not_get_in_is_sent_elsewhere(client: httpx.AsyncClient, fleet: FakeFleet) -> None:
    assert await served_by(client, lost=FIRST) == SECOND
    assert fleet.suspected == [FIRST]
    fleet.states = [host(FIRST)]
    assert await served_by(client, lost=FIRST) == FIRST, "there is no other"


async def test_a_full_cluster_says_when_to_come_back(client: httpx.AsyncClient, fleet: FakeFleet) -> None:
    fleet.states = [host("a", full=7.0), host("b", full=3.0)]
    assert (await client.get("/config.json?scene=garden")).json()["retry_after_s"] == 3.0


async def test_without_a_host_all_is_refused_for_now(client: httpx.AsyncClient, fleet: FakeFleet) -> None:
    assert (await client.get("/healthz")).status_code == 200
    fleet.states = []
    for path in ("/config.json?scene=garden", "/healthz", "/scenes", "/"):
        answer = await client.get(path)
        assert (answer.status_code, answer.headers["retry-after"]) == (503, "2"), path
        assert answer.json()["type"] == "tigas:overloaded"


async def test_frames_are_asked_for_at_the_host(client: httpx.AsyncClient) -> None:
    body = render_request(scene="garden").model_dump(mode="json", exclude_none=True)
    answer = await client.post("/render", json=body)
    assert (answer.status_code, answer.headers["location"]) == (307, f"http://{FIRST}.test:8080/render")
    assert (await client.post("/render", json={})).status_code == 400


async def test_names_of_any_length_and_other_hosts_names_are_refused(client: httpx.AsyncClient) -> None:
    for status, asked in (
        (400, {"params": {"scene": "x" * 257}}),
        (400, {"params": {"lost": "x" * 257}}),
        (421, {"headers": {"Host": "evil.example"}}),
        (403, {"headers": {"Origin": "https://evil.example"}}),
    ):
        assert (await client.get("/config.json", **asked)).status_code == status  # type: ignore[arg-type]


async def test_metrics_of_hosts_and_viewers(client: httpx.AsyncClient, fleet: FakeFleet) -> None:
    fleet.states = [host("a", viewers=3, queue_age_s=0.02), host("b", full=5.0)]
    for viewer in ({}, {"at": "a"}, {"lost": "b"}, {"silent": "b"}):
        await served_by(client, **viewer)
    told = await figures(client)
    assert told("tigas_director_hosts") == 2
    assert told("tigas_director_viewers", host="a") == 3
    assert [told("tigas_director_host_full", host=name) for name in "ab"] == [0, 1]
    assert told("tigas_director_host_queue_age_seconds", host="a") == 0.02
    assert told("tigas_director_placements_total", host="a") == 3
    assert [told("tigas_director_redirects_total", why=why) for why in ("lost", "silent", "moved")] == [1, 1, 0]
