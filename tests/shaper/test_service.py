"""The status of a running shaper, as its watchers see it."""

from __future__ import annotations

import asyncio
import json

import pytest

from tests.shaper.fakes import FakeGateway, FakeLink, FakeTime
from tigas_common.wire.shaper import LinkSetting
from tigas_shaper.player import Player
from tigas_shaper.service import Shaper
from tigas_shaper.traces.library import TraceLibrary

pytestmark = pytest.mark.anyio


async def test_watchers_see_the_newest_status_until_the_shaper_stops() -> None:
    time = FakeTime()
    link = FakeLink(time)
    player = Player(link, LinkSetting(100_000, 50_000), clock=time.clock, sleep=time.sleep)
    shaper = Shaper(link, FakeGateway(), player, TraceLibrary(None))  # type: ignore[arg-type]
    watching = asyncio.create_task(shaper._watch())
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
    assert json.loads(seen[-1].model_dump_json())["down"]["queue_bytes"] == 12_500
