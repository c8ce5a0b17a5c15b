"""Which devices there are to render on."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from tigas_common.errors import StartError
from tigas_render.settings import RenderSettings
from tigas_render.workers import devices as devices_module
from tigas_render.workers.devices import devices_for, names


@pytest.fixture
def gpus(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A machine with three GPUs, of which CUDA shows two."""
    for name in ("nvidia0", "nvidia1", "nvidia7", "nvidiactl", "nvidia-uvm"):
        (tmp_path / name).touch()
    monkeypatch.setattr(devices_module, "DEV", tmp_path)
    monkeypatch.setattr(devices_module, "COUNT", (sys.executable, "-c", "print(2)"))
    return tmp_path


@pytest.mark.parametrize("device", ["auto", "cuda"])
def test_all_gpus_that_cuda_shows_are_used(gpus: Path, device: str) -> None:
    assert devices_for(RenderSettings(device=device)) == ("cuda:0", "cuda:1")


@pytest.mark.parametrize("device", ["cpu", "cuda:1", "instant:5000"])
def test_one_that_is_named_is_the_only_one(gpus: Path, device: str) -> None:
    assert devices_for(RenderSettings(device=device)) == (device,)


def test_several_may_be_named(gpus: Path) -> None:
    assert devices_for(RenderSettings(device="cuda:0,cuda:2")) == ("cuda:0", "cuda:2")
    with pytest.raises(StartError, match=r"cuda:2 is named twice"):
        devices_for(RenderSettings(device="cuda:2,cuda:0,cuda:2"))


def test_a_machine_with_one_gpu_is_not_asked_for_more(gpus: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(devices_module, "COUNT", ("/nothing/to/run",))
    (gpus / "nvidia0").unlink()
    (gpus / "nvidia1").unlink()
    assert devices_for(RenderSettings(device="cuda")) == ("cuda",)


@pytest.mark.parametrize("program", ["raise ImportError('cuda')", "print(0)", "print('none')"])
def test_where_cuda_shows_none_the_engine_says_so(gpus: Path, monkeypatch: pytest.MonkeyPatch, program: str) -> None:
    monkeypatch.setattr(devices_module, "COUNT", (sys.executable, "-c", program))
    assert devices_for(RenderSettings(device="auto")) == ("auto",)


def test_no_two_devices_are_called_the_same() -> None:
    assert names(("instant", "cuda:0", "instant")) == ("instant#0", "cuda:0", "instant#2")


@pytest.mark.parametrize("given", ["", ",", "cuda:0,", "auto,cpu", "cuda,cuda:1", "cuda:x", "gpu", "instant:9:0"])
def test_other_devices_are_refused(given: str) -> None:
    with pytest.raises(ValueError, match="device"):
        RenderSettings(device=given)


def test_several_devices_need_linux(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.platform", "darwin")
    with pytest.raises(StartError, match="Linux"):
        devices_for(RenderSettings(device="instant,instant"))
