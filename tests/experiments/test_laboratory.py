"""What runs share: kept while it lives, started again when it has died, and for one experiment at a time."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from stat import S_IMODE

import pytest

from tigas_common.errors import StartError
from tigas_lab.laboratory import Kept, laboratory
from tigas_lab.lock import exclusive, services_lock


class Counted:
    """Something that is opened and closed, and may die."""

    def __init__(self) -> None:
        self.opened = 0
        self.closed = 0
        self.alive = True

    @asynccontextmanager
    async def open(self) -> AsyncIterator[int]:
        self.opened += 1
        yield self.opened
        self.closed += 1

    async def lives(self, _: int) -> bool:
        return self.alive


def test_a_resource_is_opened_once_and_again_when_it_has_died() -> None:
    async def use() -> None:
        counted = Counted()
        kept = Kept(counted.open, counted.lives)
        assert [await kept.get(), await kept.get()] == [1, 1]
        counted.alive = False
        assert await kept.get() == 2
        assert counted.closed == 1, "the dead one was tidied up"
        await kept.close()
        await kept.close()
        assert (counted.opened, counted.closed) == (2, 2)

    asyncio.run(use())


def test_one_holder_at_a_time(tmp_path: Path) -> None:
    lock = tmp_path / "lock"
    with exclusive(lock, "no"), pytest.raises(StartError, match=r"^not you$"), exclusive(lock, "not you"):
        pass
    with exclusive(lock, "no"):
        pass
    assert S_IMODE(lock.stat().st_mode) == 0o666, "what root has left behind keeps nobody out"


@pytest.mark.parametrize("url", ["http://localhost:99999", "http://[::1"])
def test_what_is_no_url_is_told_in_a_sentence(url: str) -> None:
    with pytest.raises(StartError, match=r"is no URL: .+\.$"):
        services_lock(url)


def test_services_are_the_same_whatever_they_are_called() -> None:
    assert services_lock("http://localhost:8080") == services_lock("http://127.0.0.1:8080/")
    assert services_lock("http://localhost:8080") != services_lock("http://localhost:8081")
    assert "/" not in services_lock("http://a..%2fb/../c").name


def test_another_experiment_s_services_are_left_alone() -> None:
    async def open_it() -> None:
        async with laboratory("http://127.0.0.1:9", None, None):
            pass

    with (
        exclusive(services_lock("http://127.0.0.1:9"), ""),
        pytest.raises(StartError, match=r"^Another experiment uses the services"),
    ):
        asyncio.run(open_it())
