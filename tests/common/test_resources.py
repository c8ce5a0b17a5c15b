"""Processors within the quota of control groups, and memory that goes back to the system."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.prerequisites import LINUX
from tigas_common.resources import quotas, usable_processors

MINE = "proc/self/cgroup"


@pytest.fixture(autouse=True)
def sixteen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(16)), raising=False)


@pytest.mark.parametrize(
    ("files", "processors"),
    [
        pytest.param({}, 16, id="no control groups"),
        pytest.param({MINE: "0::/\n"}, 16, id="no limit at the top"),
        pytest.param({MINE: "0::/a\n", "sys/fs/cgroup/a/cpu.max": "max 100000\n"}, 16, id="no limit"),
        pytest.param({MINE: "0::/\n", "sys/fs/cgroup/cpu.max": "400000 100000\n"}, 4, id="a container"),
        pytest.param({MINE: "0::/\n", "sys/fs/cgroup/cpu.max": "250000 100000\n"}, 2, id="whole ones"),
        pytest.param({MINE: "0::/\n", "sys/fs/cgroup/cpu.max": "50000 100000\n"}, 1, id="at least one"),
        pytest.param({MINE: "0::/\n", "sys/fs/cgroup/cpu.max": "6400000 100000\n"}, 16, id="more than there are"),
        pytest.param(
            {
                MINE: "0::/slice/service\n",
                "sys/fs/cgroup/slice/cpu.max": "300000 100000\n",
                "sys/fs/cgroup/slice/service/cpu.max": "max 100000\n",
            },
            3,
            id="the group above",
        ),
        pytest.param(
            {
                MINE: "3:cpuset:/\n2:cpu,cpuacct:/docker/1f\n0::/\n",
                "sys/fs/cgroup/cpu,cpuacct/cpu.cfs_quota_us": "600000\n",
                "sys/fs/cgroup/cpu,cpuacct/cpu.cfs_period_us": "100000\n",
            },
            6,
            id="a container of version 1, which sees its own group as the top",
        ),
        pytest.param(
            {
                MINE: "1:cpu:/\n",
                "sys/fs/cgroup/cpu/cpu.cfs_quota_us": "-1\n",
                "sys/fs/cgroup/cpu/cpu.cfs_period_us": "100000\n",
            },
            16,
            id="no limit in version 1",
        ),
    ],
)
def test_no_more_than_control_groups_have_time_for(tmp_path: Path, files: dict[str, str], processors: int) -> None:
    write(tmp_path, files)
    assert usable_processors(tmp_path) == processors


@pytest.mark.parametrize(
    ("files", "counted"),
    [
        pytest.param(
            {
                MINE: "0::/\n",
                "sys/fs/cgroup/cpu.max": "250000 100000\n",
                "sys/fs/cgroup/cpu.stat": "usage_usec 1500000\nnr_periods 40\nnr_throttled 7\n",
            },
            [(2.5, 1.5, 7)],
            id="version 2",
        ),
        pytest.param(
            {
                MINE: "2:cpu,cpuacct:/a\n",
                "sys/fs/cgroup/cpu,cpuacct/a/cpu.cfs_quota_us": "200000\n",
                "sys/fs/cgroup/cpu,cpuacct/a/cpu.cfs_period_us": "100000\n",
                "sys/fs/cgroup/cpu,cpuacct/a/cpu.stat": "nr_periods 40\nnr_throttled 7\nthrottled_time 9\n",
                "sys/fs/cgroup/cpu,cpuacct/a/cpuacct.usage": "1500000000\n",
            },
            [(2.0, 1.5, 7)],
            id="version 1",
        ),
        pytest.param(
            {MINE: "0::/\n", "sys/fs/cgroup/cpu.max": "100000 100000\n"}, [(1.0, None, 0)], id="nothing is counted"
        ),
        pytest.param(
            {MINE: "0::/\n", "sys/fs/cgroup/cpu.max": "max 100000\n", "sys/fs/cgroup/cpu.stat": "usage_usec 1\n"},
            [],
            id="no limit",
        ),
    ],
)
def test_what_control_groups_have_used(
    tmp_path: Path, files: dict[str, str], counted: list[tuple[float, float | None, int]]
) -> None:
    write(tmp_path, files)
    assert [(quota.processors, quota.used_s, quota.throttled) for quota in quotas(tmp_path)] == counted


def write(root: Path, files: dict[str, str]) -> None:
    for name, text in files.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(text)


def test_this_process_has_one_at_least() -> None:
    assert 1 <= usable_processors() <= 16


PROGRAM = """
import threading
from pathlib import Path
from tigas_common.resources import release_memory, use_one_arena

def resident():
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096

def use():
    [bytes(20_000) for _ in range(10_000)]

use_one_arena()
before = resident()
threads = [threading.Thread(target=use) for _ in range(4)]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
release_memory()
print(resident() - before)
"""


@LINUX.mark
def test_what_threads_have_freed_goes_back_to_the_system() -> None:
    grown = int(subprocess.run([sys.executable, "-c", PROGRAM], check=True, capture_output=True, text=True).stdout)
    assert grown < 10_000_000  # of 800 MB
