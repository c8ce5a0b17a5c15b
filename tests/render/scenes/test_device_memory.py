"""Work refused by a full device is retried once after unloading a scene."""

from __future__ import annotations

import gc
import weakref

import pytest

from tigas_common.errors import OutOfDeviceMemory
from tigas_render.scenes.device_memory import with_room

pytestmark = pytest.mark.anyio


class Device:
    """A device with room after this many evictions, and scenes to evict."""

    def __init__(self, missing: int, evictable: int) -> None:
        self.missing = missing
        self.evictable = evictable
        self.attempts = 0
        self.held: weakref.ref[Device] | None = None

    async def attempt(self) -> str:
        self.attempts += 1
        if self.missing > 0:
            allocated = Device(0, 0)
            self.held = weakref.ref(allocated)
            raise OutOfDeviceMemory("full")
        assert self.held is None or self.held() is None, "the failed attempt holds on to memory"
        return "done"

    def evict(self) -> bool:
        if self.evictable == 0:
            return False
        self.evictable, self.missing = self.evictable - 1, self.missing - 1
        return True


@pytest.mark.parametrize(("missing", "attempts", "evicted"), [(0, 1, 0), (1, 2, 1)])
async def test_a_second_attempt_finds_room(missing: int, attempts: int, evicted: int) -> None:
    gc.disable()  # a failed attempt's allocations must be freed without the garbage collector
    try:
        device = Device(missing, evictable=5)
        assert await with_room(device.attempt, device.evict) == "done"
    finally:
        gc.enable()
    assert (device.attempts, device.evictable) == (attempts, 5 - evicted)


@pytest.mark.parametrize(("evictable", "attempts"), [(0, 1), (1, 2), (5, 2)])
async def test_there_is_no_third(evictable: int, attempts: int) -> None:
    device = Device(2, evictable)
    with pytest.raises(OutOfDeviceMemory):
        await with_room(device.attempt, device.evict)
    assert device.attempts == attempts
