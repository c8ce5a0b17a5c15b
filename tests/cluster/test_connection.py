"""The choice of a cluster, and the messages without one."""

from __future__ import annotations

import importlib.util
import socket
from pathlib import Path

import pytest

from tests.command import tigas
from tigas_cluster.connection import OwnRay, named_cluster
from tigas_common.errors import StartError
from tigas_common.installation import install_command


def test_without_an_address_there_is_none_to_join(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RAY_ADDRESS", "")
    assert named_cluster() is None


def test_a_head_that_listens_is_joined(monkeypatch: pytest.MonkeyPatch) -> None:
    with socket.create_server(("127.0.0.1", 0)) as head:
        address = f"127.0.0.1:{head.getsockname()[1]}"
        monkeypatch.setenv("RAY_ADDRESS", address)
        assert named_cluster() == address
    with pytest.raises(StartError, match=rf"^The Ray cluster at {address} cannot be reached \(Connection refused\)\.$"):
        named_cluster()


@pytest.mark.parametrize("address", ["ray://10.0.0.1:10001", "local", "10.0.0.1"])
def test_what_is_no_head_is_refused_in_a_sentence(monkeypatch: pytest.MonkeyPatch, address: str) -> None:
    monkeypatch.setenv("RAY_ADDRESS", address)
    with pytest.raises(StartError, match=r"^RAY_ADDRESS must be the head's HOST:PORT, such as 10.0.0.1:6379, not "):
        named_cluster()


@pytest.mark.parametrize("command", ["up", "status"])
def test_without_ray_the_extra_is_named(monkeypatch: pytest.MonkeyPatch, command: str) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    run = tigas("cluster", command)
    assert (run.exit_code, run.stderr) == (
        1,
        f"A cluster needs Ray, which is not installed: {install_command('cluster')}\n",
    )


def test_the_status_of_no_cluster_is_a_sentence(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("RAY_ADDRESS", raising=False)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    run = tigas("cluster", "status")
    assert run.exit_code == 1
    assert run.stderr.startswith("No cluster runs on this machine: `tigas cluster up` starts one")


def test_what_a_ray_of_our_own_has_left_is_not_taken_for_one_that_runs(tmp_path: Path) -> None:
    own = OwnRay(tmp_path)
    (tmp_path / "process").write_text("1")
    (tmp_path / "ray_current_cluster").write_text("127.0.0.1:1")
    assert own.running() is None
