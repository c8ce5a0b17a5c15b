"""Frames in lanes: each outcome is reported once, its lane is freed, and Python goes on meanwhile."""

from __future__ import annotations

import ctypes
import os
import select
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import pytest

from tigas_render.raster.calls import Call, CallError, FrameCalls
from tigas_render.raster.lanes import FetchedImage, Job, Lanes

LIBC: Any = ctypes.CDLL(None)
WORKS, FAILS = Call(LIBC.sched_yield, ()), Call(LIBC.close, (-1,))


@dataclass
class Task(Job):
    """Runs out of room this many times."""

    fetch: tuple[Call, ...] = (WORKS,)
    tries: int = 1
    closed: list[bool] = field(default_factory=list)
    """Whether it had failed."""

    def __post_init__(self) -> None:
        self._calls = FrameCalls((WORKS,), (*self.fetch, WORKS))

    def calls(self) -> FrameCalls:
        return self._calls

    def fetched(self) -> FetchedImage | None:
        self.tries -= 1
        return None if self.tries else FetchedImage(2, 1, "png", 90, b"abcdef")

    def close(self, *, failed: bool) -> None:
        self.closed.append(failed)


@pytest.fixture
def lanes() -> Iterator[Lanes]:
    lanes = Lanes(2, lambda: None)
    yield lanes
    lanes.end()
    lanes.close()


def outcome(lanes: Lanes, task: Task) -> FetchedImage | Exception:
    """Outcome of a frame."""
    told: list[FetchedImage | Exception] = []
    lanes.begin(task, told.append)
    while not told:
        assert select.select([lanes], [], [], 10)[0]
        lanes.collect()
    assert len(told) == 1
    assert lanes.free == 2
    return told[0]


def test_an_image_comes_with_its_times(lanes: Lanes) -> None:
    task = Task((Call(LIBC.usleep, (2000,)),))
    image = outcome(lanes, task)
    assert isinstance(image, FetchedImage)
    assert image.to_host().tolist() == [[[97, 98, 99], [100, 101, 102]]]
    assert 0 < image.rendering < image.encoding + 1
    assert image.encoding >= 0.002
    assert task.closed == [False]


def test_a_frame_that_found_too_little_room_is_made_again(lanes: Lanes) -> None:
    task = Task(tries=3)
    assert isinstance(outcome(lanes, task), FetchedImage)
    assert task.closed == [False]


def test_a_failure_is_told_and_the_lane_goes_on(lanes: Lanes) -> None:
    class Refused(CallError):
        pass

    task = Task((WORKS, Call(LIBC.close, (-1,), Refused)))
    error = outcome(lanes, task)
    assert isinstance(error, Refused)
    assert str(error) == "close failed with status -1"
    assert task.closed == [True]
    assert isinstance(outcome(lanes, Task()), FetchedImage)


def test_a_frame_that_cannot_begin_leaves_the_lane_free(lanes: Lanes) -> None:
    class Refused(Task):
        def calls(self) -> FrameCalls:
            raise ValueError("no")

    task = Refused()
    with pytest.raises(ValueError, match="no"):
        lanes.begin(task, lambda _: pytest.fail("nothing can come of it"))
    assert lanes.free == 2
    assert task.closed == [True]


def test_other_lanes_go_on_meanwhile_and_the_end_waits_for_what_has_begun(lanes: Lanes) -> None:
    counter, event = ctypes.create_string_buffer(8), os.eventfd(0)
    waiting = Task((Call(LIBC.eventfd_read, (event, ctypes.addressof(counter))),))
    told: list[FetchedImage | Exception] = []
    lanes.begin(waiting, told.append)
    lanes.begin(Task(), told.append)
    while lanes.free == 0:
        assert select.select([lanes], [], [], 10)[0]
        lanes.collect()
    assert len(told) == 1, "the other one waits"
    os.eventfd_write(event, 7)
    lanes.end()
    lanes.collect()
    assert (len(told), counter.raw[0]) == (2, 7)
    with pytest.raises(RuntimeError, match="ended"):
        lanes.begin(Task(), told.append)
    os.close(event)


def test_each_thread_is_entered_once() -> None:
    entered: list[int] = []
    lanes = Lanes(3, lambda: entered.append(1))
    lanes.end()
    lanes.close()
    assert entered == [1, 1, 1]


def test_an_image_has_one_format_and_quality() -> None:
    jpeg = FetchedImage(1, 1, "jpeg", 35, b"jpeg")
    assert jpeg.encode("jpeg", 35) == b"jpeg"
    with pytest.raises(ValueError, match="at quality 35, not 90"):
        jpeg.encode("jpeg", 90)
    with pytest.raises(ValueError, match="as jpeg, not png"):
        jpeg.encode("png", 35)
    with pytest.raises(ValueError, match="as jpeg, not png"):
        jpeg.to_host()


def test_a_job_runs_on_the_calling_thread_until_its_buffers_are_large_enough() -> None:
    task = Task(tries=3)
    assert task.run().content == b"abcdef"
    assert (task.tries, task.closed) == (0, [False])
    failing = Task((FAILS,))
    with pytest.raises(CallError):
        failing.run()
    assert failing.closed == [True]


def test_a_callback_that_raises_costs_the_other_frames_nothing(lanes: Lanes) -> None:
    delivered: list[FetchedImage | Exception] = []

    def deliver(image: FetchedImage | Exception) -> None:
        delivered.append(image)
        raise ValueError("an answer of another viewer")

    for _ in range(2):
        lanes.begin(Task(), deliver)
    while len(delivered) < 2:
        assert select.select([lanes], [], [], 10)[0]
        lanes.collect()
    assert lanes.free == 2
    assert isinstance(outcome(lanes, Task()), FetchedImage)


def test_a_job_that_cannot_be_closed_frees_its_lane(lanes: Lanes) -> None:
    class Unclosable(Task):
        def close(self, *, failed: bool) -> None:
            raise RuntimeError("the device is gone")

    assert isinstance(outcome(lanes, Unclosable()), RuntimeError)
    assert isinstance(outcome(lanes, Task()), FetchedImage)
