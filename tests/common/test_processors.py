"""How many processors control groups leave a service."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from tigas_common.processors import usable_processors

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
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    assert usable_processors(tmp_path) == processors


def test_this_process_has_one_at_least() -> None:
    assert 1 <= usable_processors() <= 16
