"""Measures the polite before, during and after one attack, and the memory of the service that is attacked."""

from __future__ import annotations

import json
import math
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx

from benchmarks.hostile.attacks import Attack
from benchmarks.hostile.client import EXPERIMENT, RUN, request
from benchmarks.hostile.services import Name, Ports, running
from benchmarks.services import START_S, STOP_S
from tigas_common import processes

WARM_UP_S = 5.0
STREAMS, STREAM_S = 4, 3.0
"""As many streams as the packager allows, and how long they run."""
LINK = ("at", "position_ms", "target_kbps", "delivered_kbps", "queue_ms", "drops", "up_delivered_kbps")
LINKS = 8_000
"""A megabyte of them."""
STREAM = {**request(1280, 720), "frame_rate": 30}
RECOVERY_S = 30.0
"""After the attack, until memory must be back."""
SAMPLE_S = 0.25
TIMES_ALONE, MORE_MS = 2, 20
"""The goal: the polite clients' p95 during an attack, as a multiple of their p95 alone, and in milliseconds."""
MEMORY_BACK = 1.05
"""The goal: memory afterwards, relative to the memory before."""


@dataclass(frozen=True, slots=True)
class Times:
    """Response times of one polite client in one phase, in milliseconds."""

    asked: int
    lost: int
    p50: float
    p95: float

    @classmethod
    def of(cls, times: Sequence[float | None]) -> Times:
        """Missing answers count as infinite."""
        ordered = sorted(math.inf if one is None else one for one in times)
        if not ordered:
            return cls(0, 0, math.nan, math.nan)
        lost = ordered.count(math.inf)
        return cls(len(ordered), lost, statistics.median_low(ordered), ordered[math.ceil(0.95 * len(ordered)) - 1])


@dataclass(frozen=True, slots=True)
class Polite:
    """One of the polite, in the three phases."""

    who: str
    before: Times
    during: Times
    after: Times

    @property
    def faults(self) -> Iterator[str]:
        """Missed parts of the goal."""
        if not self.during.p95 <= TIMES_ALONE * self.before.p95 + MORE_MS:
            yield "slow"
        if lost := self.during.lost + self.after.lost:
            yield f"{lost} lost"


@dataclass(frozen=True, slots=True)
class Memory:
    """Of the service that is attacked, in megabytes."""

    before: float
    peak: float
    after: float

    @property
    def faults(self) -> Iterator[str]:
        """Missed parts of the goal."""
        if self.after > MEMORY_BACK * self.before:
            yield f"+{100 * (self.after / self.before - 1):.0f} % memory"


@dataclass(frozen=True, slots=True)
class Outcome:
    """Results of one attack."""

    attack: Attack
    polite: tuple[Polite, ...]
    memory: Memory
    died: tuple[str, ...]
    """Services that ended."""
    done: dict[str, int]
    """The attacker's counters."""

    @property
    def faults(self) -> Iterator[str]:
        """Results of the services, not of one polite client."""
        yield from (f"{name} died" for name in self.died)
        yield from self.memory.faults

    @property
    def holds(self) -> bool:
        """Whether the goal is met."""
        return not [*self.faults, *(fault for one in self.polite for fault in one.faults)]


@dataclass(frozen=True, slots=True)
class Cores:
    """Cores of each process. An attacker's own use of a core must not count as harm."""

    services: frozenset[int]
    clients: frozenset[int]

    @classmethod
    def share(cls) -> Cores:
        """The last core for the polite and, at the lowest priority, the attacker; the others for the services."""
        *others, last = sorted(os.sched_getaffinity(0))
        return cls(frozenset(others or [last]), frozenset([last]))


def measure(attack: Attack, seconds: float, cores: Cores, device: str, now: Callable[[str], None]) -> Outcome:
    """Carry out one attack against new services; `now` is called with the progress."""
    with tempfile.TemporaryDirectory(prefix="tigas-hostile-") as name:
        folder, ports = Path(name), Ports.free()
        now("starting")
        wanted = tuple(dict.fromkeys(("render", attack.service)))
        with running(wanted, ports, folder, set(cores.services), device) as services:
            warm_up(services, ports)
            attacked = services[attack.service]
            with _process("polite", ports, cores, folder / "polite", *attack.guests) as polite:
                samples: list[tuple[float, float]] = []

                def wait(phase: str, duration: float) -> tuple[float, float]:
                    now(phase)
                    begin = time.monotonic()
                    while (at := time.monotonic()) < begin + duration:
                        _check(polite)
                        samples.append((at, attacked.megabytes))
                        time.sleep(SAMPLE_S)
                    return begin, at

                _await(polite, lambda: any(line[2] for line in _lines(folder / "polite")))
                wait("warming up", WARM_UP_S)
                before = wait("before", seconds)
                with _process("attacks", ports, cores, folder / "attacker", attack.name) as attacker:
                    _await(attacker, lambda: (folder / "attacker").read_bytes().startswith(b"begun"))
                    during = wait("attack", seconds)
                after = wait("after", RECOVERY_S)
            died = tuple(name for name, service in services.items() if not service.runs)
        lines = _lines(folder / "polite")
        last = (after[1] - min(seconds, RECOVERY_S / 2), after[1])
        return Outcome(
            attack,
            tuple(_polite(who, lines, before, during, last) for who in ("viewer", *attack.guests)),
            Memory(
                statistics.median(_during(samples, before)),
                max(_during(samples, (during[0], after[1]))),
                statistics.median(_during(samples, (after[1] - 2, after[1]))),
            ),
            died,
            _done(folder / "attacker"),
        )


def warm_up(services: Iterable[Name], ports: Ports) -> None:
    """Use these services: memory left by the first use is no harm of an attack. The viewer uses the render service."""
    for name in services:
        with httpx.Client(base_url=f"http://127.0.0.1:{getattr(ports, name)}", trust_env=False, timeout=60) as http:
            if name == "dash":
                _streams(http)
            elif name == "store":
                _upload(http)


def _streams(http: httpx.Client) -> None:
    opened = [http.post("/sessions", json=STREAM).raise_for_status().json()["id"] for _ in range(STREAMS)]
    time.sleep(STREAM_S)
    for session in opened:
        http.delete(f"/sessions/{session}").raise_for_status()


def _upload(http: httpx.Client) -> None:
    """An upload of usual size that is refused: it has started the checking process."""
    made = http.post("/experiments", json=EXPERIMENT).raise_for_status().json()["id"]
    run = {"link": [dict.fromkeys(LINK, 1.0)] * LINKS}
    assert http.put(f"/experiments/{made}/runs/{RUN}", json=run).status_code == 400


Span = tuple[float, float]


def _polite(who: str, lines: Sequence[Any], *phases: Span) -> Polite:
    mine = [(due, milliseconds) for name, due, milliseconds in lines if name == who]
    before, during, after = (Times.of(_during(mine, phase)) for phase in phases)
    return Polite(who, before, during, after)


def _during(samples: Sequence[tuple[float, Any]], phase: Span) -> list[Any]:
    return [value for at, value in samples if phase[0] <= at < phase[1]]


@contextmanager
def _process(
    module: str, ports: Ports, cores: Cores, output: Path, *arguments: str
) -> Iterator[subprocess.Popen[bytes]]:
    """One of this package's programs, which writes into a file, until the context ends."""
    listed = ",".join(map(str, sorted(cores.clients)))
    command = [sys.executable, "-m", f"benchmarks.hostile.{module}", str(ports), listed, *arguments]
    with output.open("wb") as file, processes.run_process(command, STOP_S, stdout=file) as process:
        yield process


def _await(process: subprocess.Popen[bytes], condition: Callable[[], bool]) -> None:
    """Wait until one of the programs is so far. Raises RuntimeError if it ends, or takes minutes."""
    late = time.monotonic() + START_S
    while not condition():
        _check(process)
        if time.monotonic() > late:
            raise RuntimeError("Nothing comes of it: the machine is too slow, or a service has failed.")
        time.sleep(0.05)


def _check(process: subprocess.Popen[bytes]) -> None:
    """Raises RuntimeError if one of the programs has ended by itself."""
    if process.poll() is not None:
        raise RuntimeError(f"A program of the benchmark has ended with status {process.returncode}.")


def _lines(output: Path) -> list[Any]:
    """The polite clients' reports."""
    return [json.loads(line) for line in output.read_text().splitlines(True) if line.endswith("]\n")]


def _done(output: Path) -> dict[str, int]:
    """The attacker's counters; empty if it had to be killed."""
    *_, last = output.read_text().splitlines() or [""]
    done: dict[str, int] = json.loads(last) if last.startswith("{") else {}
    return done
