"""The client without an event loop of its caller's."""

from __future__ import annotations

import asyncio
import gc
import socket
import threading

import pytest

import tigas
from tests.client.conftest import Served
from tests.client.test_async_client import AHEAD, WALL, is_red

pytestmark = pytest.mark.anyio


async def test_pictures_and_paths_come_without_an_event_loop(served: Served) -> None:
    def program() -> None:
        with tigas.Client(served.url) as client:
            assert {scene.id for scene in client.scenes()} == {"courtyard", "wall"}
            pose = client.start_pose("wall")
            assert is_red(client.render(pose, **WALL).getpixel((32, 18)))
            assert client.frame(pose, **WALL).protocol == "HTTP/3"
            assert len([*client.render_path([pose] * 6, **WALL)]) == 6
            first = next(client.render_path([pose] * 6, **WALL))  # and no more of it
            assert first.size == (64, 36)
            with pytest.raises(tigas.Refused, match="no scene"):
                client.scene("attic")
            pictures = client.render_path([pose] * 6, **WALL)
            next(pictures)
        for asked in (client.config, lambda: next(pictures)):
            with pytest.raises(tigas.ClientError, match="was closed"):
                asked()

    await asyncio.to_thread(program)


async def test_a_client_that_is_let_go_leaves_no_thread(served: Served) -> None:
    def program() -> None:
        assert is_red(tigas.Client(served.url).render(AHEAD, **WALL).getpixel((32, 18)))
        gc.collect()

    await asyncio.to_thread(program)
    assert "tigas client" not in {thread.name for thread in threading.enumerate()}


async def test_closing_ends_the_requests_of_other_threads() -> None:
    with socket.create_server(("127.0.0.1", 0)) as silent:
        client = tigas.Client(f"http://127.0.0.1:{silent.getsockname()[1]}")
        asking = asyncio.create_task(asyncio.to_thread(client.scenes))
        accepted, _ = await asyncio.to_thread(silent.accept)
        with accepted:
            await asyncio.to_thread(client.close)
            with pytest.raises(tigas.ClientError, match="The client was closed"):
                await asking
