"""The registry when the device's memory is full."""

from __future__ import annotations

import weakref

import pytest

from tests.render.scenes.registry_bench import Bench, Packed
from tigas_common.errors import OutOfDeviceMemory
from tigas_render.gaussians import Batches
from tigas_render.raster.base import PreparedScene

pytestmark = pytest.mark.anyio


@pytest.fixture
def bench() -> Bench:
    return Bench()


async def test_a_device_that_is_full_gets_room_once(bench: Bench) -> None:
    bench.add("old")
    bench.add("older")
    bench.add("new")
    registry = bench.registry()
    await registry.load("older")
    bench.now += 1
    await registry.load("old")
    bench.errors["new"] = OutOfDeviceMemory("full")
    with pytest.raises(OutOfDeviceMemory):
        await registry.load("new")
    assert bench.opened == ["older", "old", "new", "new"]
    assert [registry.info(id).state for id in ("older", "old", "new")] == ["unloaded", "loaded", "unloaded"]
    del bench.errors["new"]
    await registry.load("new")  # the device is tried again: its free memory varies
    assert registry.info("new").state == "loaded"


async def test_what_did_not_fit_is_gone_before_it_is_tried_again(bench: Bench) -> None:
    bench.add("old")
    bench.add("new")
    registry = bench.registry()
    await registry.load("old")
    half: list[weakref.ref[Packed]] = []

    def pack(scene: Batches) -> PreparedScene:
        packed = Packed(len(scene.gathered()))
        if not half:
            half.append(weakref.ref(packed))
            raise OutOfDeviceMemory("full")
        assert half[0]() is None, "the first attempt still holds its memory"
        return packed

    registry._pack = pack
    await registry.load("new")
    assert registry.info("new").state == "loaded"


async def test_scenes_in_use_are_not_taken_for_a_full_device(bench: Bench) -> None:
    bench.add("used")
    bench.add("new")
    registry = bench.registry()
    bench.errors["new"] = OutOfDeviceMemory("full")
    async with registry.use("used"):
        with pytest.raises(OutOfDeviceMemory):
            await registry.load("new")
        assert bench.opened == ["used", "new"]
    assert registry.info("used").state == "loaded"
