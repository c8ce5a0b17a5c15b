"""The repository's own traces: reproducible bit for bit, and as varied as the recordings that they were fitted to."""

from __future__ import annotations

from pathlib import Path
from statistics import correlation, fmean, pstdev

import pytest

from tests.shared_data import shared_file
from tigas_shaper.traces.formats import load_trace
from tigas_shaper.traces.generator import (
    BUS_4G,
    DRIVING_5G,
    DSL,
    TRAIN_4G,
    LinkModel,
    Regime,
    generate,
    make_own_traces,
    write_own_traces,
)
from tigas_shaper.traces.trace import NetworkTrace

KEPT = Path(__file__).parents[3] / "traces" / "network"
HOUR_MS = 3_600_000


def averaged(trace: NetworkTrace) -> list[float]:
    """Mean rate towards the client in each second of a trace of 100 ms or 1 s steps, Mbit/s."""
    tenths = [trace.state_at(t).down_kbps / 1000 for t in range(0, trace.duration_ms, 100)]
    return [fmean(tenths[start : start + 10]) for start in range(0, len(tenths), 10)]


def recorded(*parts: str) -> list[float]:
    trace = load_trace(shared_file("traces", *parts))
    return [trace.state_at(t).down_kbps / 1000 for t in range(0, trace.duration_ms, 1000)]


def variation(rates: list[float]) -> float:
    return pstdev(rates) / fmean(rates)


def autocorrelation(rates: list[float], lag: int) -> float:
    return correlation(rates[:-lag], rates[lag:])


def test_generating_again_gives_the_files_in_the_repository_byte_for_byte(tmp_path: Path) -> None:
    made = {path.name: path.read_bytes() for path in write_own_traces(tmp_path)}
    assert made == {path.name: path.read_bytes() for path in KEPT.glob("*.csv")}


def test_the_kept_files_are_what_they_are_called() -> None:
    kept = {path.stem: load_trace(path) for path in KEPT.glob("*.csv")}
    assert kept == {trace.name: trace for trace in make_own_traces()}
    assert all(60_000 <= trace.duration_ms <= 300_000 for trace in kept.values())
    assert kept["outage"].outages == [(20_000, 1_000), (40_000, 5_000)]
    assert {state.up_kbps for state in kept["outage"].states if not state.down_kbps} == {0}
    assert kept["step-down"].state_at(29_999).down_kbps == kept["step-up"].state_at(30_000).down_kbps == 40_000
    assert max(path.stat().st_size for path in KEPT.glob("*.csv")) < 50_000


def test_another_seed_gives_another_trace_of_the_same_model() -> None:
    first, second = (generate("t", BUS_4G, 60_000, seed) for seed in (1, 2))
    assert first != second
    assert first == generate("t", BUS_4G, 60_000, 1)


@pytest.mark.parametrize(
    ("model", "mean", "cv", "at_1_s", "at_10_s"),
    [
        # the means over the recordings in docs/results/2026-11-trace-models.md; DSL: over its parameters
        (BUS_4G, 26.0, 0.46, 0.76, 0.38),
        (TRAIN_4G, 23.1, 0.60, 0.70, 0.25),
        (DRIVING_5G, 61.3, 1.35, 0.86, 0.34),
        (DSL, 13.5, 0.26, 0.91, 0.35),
    ],
)
def test_an_hour_of_a_model_varies_like_its_recordings(
    model: LinkModel, mean: float, cv: float, at_1_s: float, at_10_s: float
) -> None:
    rates = averaged(generate("t", model, HOUR_MS, seed=1))
    assert fmean(rates) == pytest.approx(mean, rel=0.1)
    assert variation(rates) == pytest.approx(cv, rel=0.1)
    assert autocorrelation(rates, 1) == pytest.approx(at_1_s, abs=0.12)
    assert autocorrelation(rates, 10) == pytest.approx(at_10_s, abs=0.2)


def test_a_regimes_mean_rate_is_its_own_and_its_dwell_times_are_kept() -> None:
    model = LinkModel(
        regimes={"on": Regime(10_000, 0.3, 4, {"off": 1}), "off": Regime(0, 0, 1, {"on": 1})},
        variation=((1.0, 0.5),),
        up_share=0.5,
        delay_ms=10,
        jitter_ms=1,
        step_ms=100,
    )
    trace = generate("t", model, HOUR_MS, seed=3)
    gaps = trace.outages
    assert fmean(length for _, length in gaps) == pytest.approx(1_000, rel=0.1)
    assert len(gaps) == pytest.approx(HOUR_MS / 5_000, rel=0.1)
    assert trace.mean_down_kbps == pytest.approx(8_000, rel=0.05)
    assert trace.mean_up_kbps == pytest.approx(4_000, rel=0.05)
    assert all(state.down_kbps == int(state.down_kbps) >= 0 for state in trace.states)


def test_the_models_were_fitted_to_these_recordings() -> None:
    buses = [recorded("ghent4g-sabre-json", f"report_bus_000{number}.json") for number in (1, 2, 3)]
    assert fmean(map(fmean, buses)) == pytest.approx(26.0, abs=0.1)
    assert fmean(map(variation, buses)) == pytest.approx(0.46, abs=0.01)
    assert fmean(autocorrelation(rates, 1) for rates in buses) == pytest.approx(0.76, abs=0.01)
    assert fmean(autocorrelation(rates, 10) for rates in buses) == pytest.approx(0.38, abs=0.01)
    train = recorded("ghent4g-sabre-json", "report_train_0001.json")
    assert (fmean(train), variation(train)) == pytest.approx((23.1, 0.60), abs=0.03)
    drive = recorded("irish5g", "driving_B_2019.12.16_14.23.32.csv.gz")
    assert (fmean(drive), variation(drive)) == pytest.approx((61.3, 1.35), abs=0.05)
