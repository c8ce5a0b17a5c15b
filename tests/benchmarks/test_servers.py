"""The servers of the transport's benchmarks answer their clients."""

from __future__ import annotations

import pytest

from benchmarks.servers import NAMES, running
from benchmarks.transport import viewers


@pytest.mark.anyio
@pytest.mark.parametrize("name", NAMES)
async def test_a_server_answers_over_webtransport_and_by_post(name: str) -> None:
    with running(name, 2000) as server:
        for over in ("webtransport", "post"):
            async with viewers(server, over) as asks:
                for ask in asks:
                    await ask()
        assert server.megabytes() > 0
