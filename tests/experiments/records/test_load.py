"""The load of a machine: differences between readings, real readings, and runs on a machine that was too busy."""

from __future__ import annotations

import asyncio
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import psutil
import pytest

from tests.eventually import eventually
from tests.prerequisites import SCHEDSTAT
from tigas_common.resources import Quota
from tigas_experiments.records import load
from tigas_experiments.records.load import Load, LoadSample, Reading, Thread, monitor_load

NOBODY = "http://127.0.0.1:9"
"""Where no service answers."""


def load_of(*samples: LoadSample) -> Load:
    found = Load.summarise(samples)
    assert found is not None
    return found


def sample(
    cpu: float = 0.5,
    *,
    throttled: bool = False,
    threads: dict[str, float] | None = None,
    render: float | None = None,
) -> LoadSample:
    return LoadSample(
        unix_ms=0, cpu=cpu, processors=2.5, throttled=throttled, threads=threads, render=render, load_average=1
    )


@pytest.mark.parametrize(
    ("busy", "saturated"),
    [
        pytest.param([0.5] * 10, False, id="never"),
        pytest.param([0.5] * 9 + [1.0], False, id="seldom"),
        pytest.param([0.5] * 8 + [1.0] * 2, True, id="often"),
        pytest.param([15 / 16] * 10, True, id="15 of 16 processors"),
    ],
)
def test_saturation(busy: list[float], saturated: bool) -> None:
    assert load_of(*map(sample, busy)).saturated is saturated


def test_a_group_that_had_to_wait_is_saturated_however_little_it_used_on_average() -> None:
    found = load_of(sample(0.2, throttled=True), sample(0.2))
    assert (found.saturated_share, found.saturated, found.processors) == (0.5, True, 2.5)


def test_threads_at_their_limit_are_named_and_saturate_no_processors() -> None:
    found = load_of(
        *[sample(threads={"chromium": 0.95, "tigas dash": 0.5, "tigas render": 1.0})] * 2,
        *[sample(threads={"chromium": 0.95, "tigas dash": 0.9, "tigas render": 0.1})] * 2,
        *[sample(threads={"tigas lab": 0.95})],
        *[sample(threads={"chromium": 0.1})] * 5,
    )
    assert found.pegged == {"chromium": 0.4, "tigas lab": 0.1, "tigas render": 0.2}
    assert list(found.often_pegged.items()) == [("chromium", 0.4), ("tigas render", 0.2)]
    assert found.worst_pegged == ("chromium", 0.4)
    assert not found.saturated


def test_a_render_service_at_its_limit_saturates_a_run_on_an_idle_machine() -> None:
    found = load_of(*[sample(render=0.95)] * 2, *[sample(render=0.9)] * 6, sample(), sample(1.0))
    assert (found.render_busy_share, found.saturated_share) == (0.25, 0.3)
    assert load_of(sample()).render_busy_share is None


def test_threads_that_nobody_watched_are_unknown_and_those_that_kept_up_are_not() -> None:
    assert load_of(sample()).pegged is None
    assert load_of(sample(threads={"chromium": 0.5})).pegged == {}


def test_early_records_say_nothing_of_what_was_not_watched() -> None:
    early = '{"cpu_mean": 0.5, "cpu_max": 1.0, "saturated_share": 0.2, "load_average_max": 3.0, "processors": 64}'
    found = Load.model_validate_json(early)
    assert (found.saturated, found.pegged, found.often_pegged, found.worst_pegged) == (True, None, {}, None)
    assert found.services is None
    line = LoadSample.model_validate_json('{"unix_ms": 1.0, "cpu": 0.5, "load_average": 1.0}')
    assert (line.processors, line.throttled, line.threads) == (None, False, None)
    assert Load.summarise([]) is None


def quota(used_s: float | None, throttled: int = 0, group: str = "a") -> Quota:
    return Quota(Path(group), 2.0, used_s, throttled)


def passed(before: Reading, after: Reading) -> LoadSample:
    return after.sample_since(before, unix_ms=7.0, load_average=3.0)


def test_the_share_of_the_processors_that_may_be_used() -> None:
    sample = passed(Reading(10.0, 5.0, 5.0, 4), Reading(10.5, 6.5, 5.5, 4))
    assert (sample.cpu, sample.processors, sample.throttled, sample.threads) == (0.75, 4.0, False, None)
    assert (sample.unix_ms, sample.load_average) == (7.0, 3.0)


@pytest.mark.parametrize(
    ("before", "after", "cpu", "throttled"),
    [
        pytest.param(quota(8.0), quota(8.95), 0.95, False, id="the quota is fuller"),
        pytest.param(quota(8.0), quota(8.05), 0.25, False, id="the machine is"),
        pytest.param(quota(8.0), quota(9.5), 1.0, False, id="more than the quota at once"),
        pytest.param(quota(8.0, 3), quota(8.05, 4), 0.25, True, id="it had to wait"),
        pytest.param(quota(None, 3), quota(None, 4), 0.25, True, id="nobody tells what it used"),
        pytest.param(quota(8.0, 3, "b"), quota(50.0, 4), 0.25, False, id="another group"),
    ],
)
def test_a_quota_of_two_processors_on_sixty_four(before: Quota, after: Quota, cpu: float, throttled: bool) -> None:
    sample = passed(Reading(10.0, 0.0, 0.0, 64, (before,)), Reading(10.5, 8.0, 24.0, 64, (after,)))
    assert sample.cpu == pytest.approx(cpu)
    assert (sample.processors, sample.throttled) == (2.0, throttled)


def test_the_busiest_thread_of_each_process() -> None:
    before = {(1, 1): Thread("chromium", 3.0), (1, 2): Thread("chromium", 3.0), (2, 2): Thread("tigas render", 1.0)}
    after = {
        (1, 1): Thread("chromium", 3.1),
        (1, 2): Thread("chromium", 3.48),
        (2, 2): Thread("tigas render", 1.6),
        (3, 3): Thread("tigas dash", 9.0),
    }
    sample = passed(Reading(10.0, 0, 0, 8, threads=before), Reading(10.5, 0, 0, 8, threads=after))
    assert sample.threads == {"chromium": 0.96, "tigas render": 1.0, "tigas dash": 0.0}


@SCHEDSTAT.mark
def test_a_thread_that_waits_for_a_processor_is_as_busy_as_one_that_runs() -> None:
    spin = "import os\nos.sched_setaffinity(0, {min(os.sched_getaffinity(0))})\nwhile True: pass"
    spinning = [subprocess.Popen([sys.executable, "-c", spin]) for _ in range(3)]
    try:
        one = psutil.Process(spinning[0].pid)

        def used_s() -> float:
            return one.cpu_times().user + one.cpu_times().system

        asyncio.run(eventually(lambda: used_s() > 0.5))
        first, began_s = Reading.take({one: "spin"}), used_s()
        asyncio.run(eventually(lambda: used_s() > began_s + 0.3))
        second = Reading.take({one: "spin"})
        assert used_s() - began_s < 0.7 * (second.at_s - first.at_s), "three share a processor"
        assert (passed(first, second).threads or {})["spin"] == pytest.approx(1.0, abs=0.1)
    finally:
        for process in spinning:
            process.kill()
            process.wait()


def test_nothing_passed_is_no_load() -> None:
    now = Reading(10.0, 5.0, 5.0, 4, (quota(1.0),))
    assert passed(now, now).cpu == 0.0


def test_only_processors_that_this_process_may_run_on_count(monkeypatch: pytest.MonkeyPatch) -> None:
    class Times(SimpleNamespace):
        def __iter__(self) -> Iterator[float]:
            return iter(vars(self).values())

    every = [
        Times(user=1.0, nice=0.0, system=2.0, idle=3.0, iowait=4.0, guest=0.5, guest_nice=0.0),
        Times(user=0.0, nice=0.0, system=0.0, idle=10.0, iowait=0.0, guest=0.0, guest_nice=0.0),
    ]
    monkeypatch.setattr(psutil, "cpu_times", lambda percpu: every)
    monkeypatch.setattr(load, "allowed_processors", lambda: frozenset({0}))
    reading = Reading.take(None)
    assert (reading.busy_s, reading.idle_s, reading.processors, reading.threads) == (3.0, 7.0, 1, None)


def test_a_watch_reads_the_threads_that_it_is_given(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(load, "SAMPLE_EVERY_S", 0)

    with subprocess.Popen([sys.executable, "-c", ""]) as short:
        ended = psutil.Process(short.pid)

    processes = {psutil.Process(): "this", ended: "ended"}

    async def watched() -> LoadSample:
        async with asyncio.timeout(30), monitor_load(NOBODY, 1, processes) as samples:
            while not samples:  # noqa: ASYNC110 - nothing announces it
                await asyncio.sleep(0)
            return samples[0]

    sample = asyncio.run(watched())
    assert sample.render is None
    assert sample.threads is not None
    assert list(sample.threads) == ["this"]
    assert 0 <= sample.cpu <= 1
    assert 0 < (sample.processors or 0) <= (os.cpu_count() or 1)
