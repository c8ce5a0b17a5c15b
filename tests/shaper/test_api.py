"""The HTTP interface over a link that only remembers."""

from __future__ import annotations

import asyncio
import shutil
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import httpx
import pytest
from starlette.types import Message

from tests.not_files import NOT_FILES
from tests.prometheus import figures
from tests.shaper.conftest import FakeGateway, FakeLink, FakeTime, make_player, trace
from tigas_common.origins import OriginPolicy
from tigas_common.wire.shaper import MAX_UPLOAD_BYTES
from tigas_shaper.api import MAX_UPLOADING, MAX_WATCHERS, create_app
from tigas_shaper.service import Shaper
from tigas_shaper.traces.csv_format import format_csv
from tigas_shaper.traces.library import MAX_UPLOADS, TraceLibrary

pytestmark = pytest.mark.anyio
PAGE = "http://localhost:8080"


@pytest.fixture
def directory(tmp_path: Path) -> Path:
    (tmp_path / "steps.csv").write_text(format_csv(trace(4_000, 0, 8_000, name="steps")))
    (tmp_path / "broken.csv").write_bytes(b"\x00\x01\x02")
    (tmp_path / "README.md").write_text("not a trace")
    return tmp_path


@pytest.fixture
def shaper(time: FakeTime, link: FakeLink, directory: Path) -> Shaper:
    return Shaper(link, FakeGateway(), make_player(time, link), TraceLibrary(directory))  # type: ignore[arg-type]


@pytest.fixture
async def client(shaper: Shaper) -> AsyncIterator[httpx.AsyncClient]:
    transport = httpx.ASGITransport(create_app(shaper, OriginPolicy(programs=False)), raise_app_exceptions=False)
    async with httpx.AsyncClient(
        transport=transport, base_url="http://localhost:8090", headers={"origin": PAGE}
    ) as client:
        yield client
    shaper.player.close()


async def test_traces_are_listed_with_what_they_amount_to(client: httpx.AsyncClient) -> None:
    broken, steps = (await client.get("/traces")).json()["traces"]
    assert steps["name"] == "steps"
    assert steps["mean_down_kbps"] == 4_000
    assert (steps["duration_ms"], steps["steps"], steps["outages"], steps["uploaded"]) == (300, 3, 1, False)
    assert broken["name"] == "broken"
    assert broken["error"].endswith(".")


async def test_an_uploaded_trace_can_be_played_and_drawn(client: httpx.AsyncClient, link: FakeLink) -> None:
    text = "1000 2000 3000".replace(" ", "\n")
    answer = await client.post("/traces?name=../../etc/my trace.txt", content=text)
    assert answer.status_code == 200, answer.text
    name = answer.json()["name"]
    assert "/" not in name
    drawn = (await client.get(f"/traces/{name}")).json()
    assert drawn["down_kbps"] == [1000, 2000, 3000]
    status = (await client.post("/start", json={"trace": name, "loop": False})).json()
    assert (status["mode"], status["trace"], status["link"]["down_kbps"]) == ("playing", name, 1000)
    assert link.queues[-1][0] == 2000


async def test_a_trace_can_be_played_at_another_delay(client: httpx.AsyncClient) -> None:
    text = "t_ms,down_kbps,up_kbps,delay_ms,jitter_ms,loss_pct\n0,1000,500,80,5,1\n100,2000,500,20,0,0\n200,,,,,\n"
    name = (await client.post("/traces?name=far.csv", content=text)).json()["name"]
    link = (await client.post("/start", json={"trace": name, "delay_ms": 25})).json()["link"]
    assert (link["down_kbps"], link["delay_ms"], link["jitter_ms"], link["loss_pct"]) == (1000, 25, 0, 1)
    link = (await client.post("/start", json={"trace": name})).json()["link"]
    assert (link["delay_ms"], link["jitter_ms"]) == (80, 5)


async def test_a_long_trace_is_drawn_by_means(client: httpx.AsyncClient) -> None:
    text = "\n".join(str(1000 + 500 * (second % 2)) for second in range(6000))
    name = (await client.post("/traces?name=long", content=text)).json()["name"]
    drawn = (await client.get(f"/traces/{name}")).json()
    assert len(drawn["times_ms"]) == len(drawn["down_kbps"]) == 600
    assert drawn["down_kbps"] == pytest.approx([1250] * 600)


async def test_the_player_is_controlled(client: httpx.AsyncClient) -> None:
    await client.post("/start", json={"trace": "steps"})
    assert (await client.post("/pause")).json()["mode"] == "paused"
    assert (await client.post("/seek", json={"position_ms": 250})).json()["link"]["down_kbps"] == 8_000
    assert (await client.post("/resume")).json()["mode"] == "playing"
    assert (await client.post("/loop", json={"loop": False})).json()["loop"] is False
    status = (await client.post("/link", json={"down_kbps": 5000, "up_kbps": 900, "delay_ms": 12.5})).json()
    assert (status["mode"], status["trace"]) == ("constant", None)
    assert status["link"] == {"down_kbps": 5000, "up_kbps": 900, "delay_ms": 12.5, "jitter_ms": 0, "loss_pct": 0}
    assert (await client.post("/stop")).json()["link"]["down_kbps"] == 100_000
    assert (await client.get("/status")).json()["backend"] == "relay"


@pytest.mark.parametrize(
    ("path", "body", "status", "kind"),
    [
        ("/start", {"trace": "nothing"}, 404, "unknown-trace"),
        ("/start", {"trace": "broken"}, 422, "broken-trace"),
        ("/start", {}, 400, "invalid-request"),
        ("/start", {"trace": "steps", "delay_ms": -1}, 400, "invalid-request"),
        ("/start", {"trace": "steps", "delay_ms": 1e9}, 400, "invalid-request"),
        ("/start", {"trace": "../../etc/passwd"}, 404, "unknown-trace"),
        ("/link", {"down_kbps": -1, "up_kbps": 1}, 400, "invalid-request"),
        ("/link", {"down_kbps": "1; reboot", "up_kbps": 1}, 400, "invalid-request"),
        ("/link", {"down_kbps": 1, "up_kbps": 1, "loss_pct": 101}, 400, "invalid-request"),
        ("/link", {"down_kbps": 1, "up_kbps": 1, "shell": "x"}, 400, "invalid-request"),
        ("/seek", {"position_ms": 0}, 409, "nothing-plays"),
        ("/pause", {}, 409, "nothing-plays"),
        ("/nowhere", {}, 404, "not-found"),
        ("/status", {}, 405, "method-not-allowed"),
    ],
)
async def test_what_cannot_be_done_gets_a_problem(
    client: httpx.AsyncClient, link: FakeLink, path: str, body: dict[str, Any], status: int, kind: str
) -> None:
    answer = await client.post(path, json=body)
    assert answer.status_code == status
    assert answer.headers["content-type"] == "application/problem+json"
    assert answer.json()["type"] == f"tigas:{kind}"
    assert answer.json()["detail"].endswith(".")
    assert link.applied == []


async def test_an_endless_upload_is_cut_off(client: httpx.AsyncClient) -> None:
    sent = 0

    async def endless() -> AsyncIterator[bytes]:
        nonlocal sent
        while True:
            sent += 1_000_000
            yield b"1" * 1_000_000

    answer = await client.post("/traces", content=endless())
    assert answer.status_code == 413
    assert sent <= MAX_UPLOAD_BYTES + 2_000_000


@pytest.mark.parametrize("kind", NOT_FILES)
async def test_what_is_no_file_among_the_traces_holds_nothing_up(
    client: httpx.AsyncClient, directory: Path, kind: str
) -> None:
    before = (await client.get("/traces")).json()
    NOT_FILES[kind](directory / "made.csv")
    assert (await client.get("/traces")).json() == before
    assert (await client.get("/traces/made")).status_code == 404


async def test_traces_whose_directory_vanished_are_gone_and_uploads_stay(
    client: httpx.AsyncClient, directory: Path
) -> None:
    await client.post("/traces?name=mine.csv", content=format_csv(trace(1_000, name="mine")))
    shutil.rmtree(directory)
    assert [one["name"] for one in (await client.get("/traces")).json()["traces"]] == ["mine"]
    assert (await client.get("/traces/steps")).status_code == 404


async def test_metrics_tell_the_links_state_and_what_crossed_it(client: httpx.AsyncClient, shaper: Shaper) -> None:
    await client.post("/link", json={"down_kbps": 8_000, "up_kbps": 2_000, "delay_ms": 20, "loss_pct": 5})
    await shaper._sample()
    told = await figures(client)
    assert told("tigas_shaper_rate_bytes_per_second", direction="down") == 1e6
    assert told("tigas_shaper_rate_bytes_per_second", direction="up") == 250_000
    assert told("tigas_shaper_sent_bytes_total", direction="down") == 25_000
    assert told("tigas_shaper_dropped_packets_total", direction="down") == 3
    assert told("tigas_shaper_queue_bytes", direction="down") == 12_500
    assert told("tigas_shaper_queue_age_seconds", direction="down") == 0.0125
    assert (told("tigas_shaper_delay_seconds"), told("tigas_shaper_loss_ratio")) == (0.02, 0.05)
    assert told("tigas_shaper_playback") == told("tigas_shaper_playback", mode="constant") == 1
    assert told("tigas_shaper_link_up") == 1
    shaper._link.close("Gone.")
    assert (await figures(client))("tigas_shaper_link_up") == 0


async def test_few_uploads_run_at_a_time_and_each_gives_its_place_back(client: httpx.AsyncClient) -> None:
    complete, begun = asyncio.Event(), asyncio.Semaphore(0)

    async def slow() -> AsyncIterator[bytes]:
        begun.release()
        await complete.wait()
        yield b"1000\n2000\n"

    uploading = [asyncio.create_task(client.post("/traces?name=slow", content=slow())) for _ in range(MAX_UPLOADING)]
    for _ in uploading:
        await begun.acquire()
    refused = await client.post("/traces?name=late", content=b"1000\n")
    assert (refused.status_code, refused.json()["type"]) == (503, "tigas:overloaded")
    complete.set()
    assert [(await each).status_code for each in uploading] == [200] * MAX_UPLOADING
    assert (await client.post("/traces?name=late", content=b"1000\n")).status_code == 200


async def test_the_latest_uploads_are_kept(client: httpx.AsyncClient) -> None:
    for number in (*range(MAX_UPLOADS), 0, MAX_UPLOADS):
        assert (await client.post(f"/traces?name=t{number}", content="1\n2")).status_code == 200
    kept = {trace["name"] for trace in (await client.get("/traces")).json()["traces"] if trace["uploaded"]}
    assert kept == {f"t{number}" for number in (0, *range(2, MAX_UPLOADS + 1))}


async def test_watchers_are_counted_from_the_first_byte_that_waits(shaper: Shaper) -> None:
    app = create_app(shaper, OriginPolicy(programs=False))
    answers: asyncio.Queue[int] = asyncio.Queue()
    unread = asyncio.Event()

    async def send(message: Message) -> None:
        if message["type"] == "http.response.start":
            await answers.put(message["status"])
            await unread.wait()  # like an unread connection

    async def receive() -> Message:
        await asyncio.Event().wait()
        raise AssertionError

    def watch() -> asyncio.Future[None]:
        headers = [(b"host", b"localhost")]
        scope = {"type": "http", "method": "GET", "path": "/events", "headers": headers, "query_string": b""}
        return asyncio.ensure_future(app(scope, receive, send))

    watching = [watch() for _ in range(MAX_WATCHERS + 3)]
    assert sorted([await answers.get() for _ in watching]) == [200] * MAX_WATCHERS + [503] * 3
    for task in watching:
        task.cancel()
    await asyncio.gather(*watching, return_exceptions=True)
    again = watch()
    assert await answers.get() == 200
    again.cancel()


async def test_watchers_see_the_newest_status_until_the_shaper_stops(shaper: Shaper) -> None:
    watching = asyncio.create_task(shaper._keep_sampling())
    seen = []
    async for status in shaper.watch():
        seen.append(status)
        if len(seen) == 3:
            shaper.stop_watching()
    watching.cancel()
    assert len(seen) == 3
    assert seen[-1].down.drops == 3
    assert seen[-1].down.delivered_kbps > 0
    assert seen[-1].down.queue_ms == pytest.approx(1.0)  # 12,500 bytes at 100 Mbit/s
    assert seen[-1].down.queue_bytes == 12_500


async def test_a_closed_link_says_why(client: httpx.AsyncClient, link: FakeLink) -> None:
    assert (await client.get("/healthz")).json() == {"status": "ok"}
    link.close("The cable is cut.")
    assert (await client.get("/status")).json()["closed"] == "The cable is cut."
    for answer in (await client.get("/healthz"), await client.post("/start", json={"trace": "steps"})):
        assert (answer.status_code, answer.json()["detail"]) == (503, "The cable is cut.")
