"""When a run's machine was too busy."""

from __future__ import annotations

import pytest

from tigas_experiments.records.load import Load, LoadSample


def load_of(*samples: LoadSample) -> Load:
    load = Load.of(samples)
    assert load is not None
    return load


def sample(cpu: float = 0.5, *, throttled: bool = False, threads: dict[str, float] | None = None) -> LoadSample:
    return LoadSample(unix_ms=0, cpu=cpu, processors=2.5, throttled=throttled, threads=threads, load_average=1)


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
    load = load_of(sample(0.2, throttled=True), sample(0.2))
    assert (load.saturated_share, load.saturated, load.processors) == (0.5, True, 2.5)


def test_threads_at_their_limit_are_named_and_saturate_no_processors() -> None:
    load = load_of(
        *[sample(threads={"chromium": 0.95, "tigas dash": 0.5, "tigas render": 1.0})] * 2,
        *[sample(threads={"chromium": 0.95, "tigas dash": 0.9, "tigas render": 0.1})] * 2,
        *[sample(threads={"tigas lab": 0.95})],
        *[sample(threads={"chromium": 0.1})] * 5,
    )
    assert load.pegged == {"chromium": 0.4, "tigas lab": 0.1, "tigas render": 0.2}
    assert list(load.often_pegged.items()) == [("chromium", 0.4), ("tigas render", 0.2)]
    assert load.worst_pegged == ("chromium", 0.4)
    assert not load.saturated


def test_threads_that_nobody_watched_are_unknown_and_those_that_kept_up_are_not() -> None:
    assert load_of(sample()).pegged is None
    assert load_of(sample(threads={"chromium": 0.5})).pegged == {}


def test_early_records_say_nothing_of_what_was_not_watched() -> None:
    early = '{"cpu_mean": 0.5, "cpu_max": 1.0, "saturated_share": 0.2, "load_average_max": 3.0, "processors": 64}'
    load = Load.model_validate_json(early)
    assert (load.saturated, load.pegged, load.often_pegged, load.worst_pegged) == (True, None, {}, None)
    assert load.services is None
    line = LoadSample.model_validate_json('{"unix_ms": 1.0, "cpu": 0.5, "load_average": 1.0}')
    assert (line.processors, line.throttled, line.threads) == (None, False, None)


def test_no_samples() -> None:
    assert Load.of([]) is None
