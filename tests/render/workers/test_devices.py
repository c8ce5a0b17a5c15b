"""Which devices there are to render on, and how many edges suit a machine."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import pytest

from tigas_common.errors import StartError
from tigas_render.settings import RenderSettings
from tigas_render.workers import devices as devices_module
from tigas_render.workers.devices import choose_devices, choose_edge_count, device_names, suggest_edge_count


@pytest.fixture
def gpus(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A machine with three GPUs, of which CUDA shows two."""
    for name in ("nvidia0", "nvidia1", "nvidia7", "nvidiactl", "nvidia-uvm"):
        (tmp_path / name).touch()
    monkeypatch.setattr(devices_module, "DEV", tmp_path)
    monkeypatch.setattr(devices_module, "COUNT_COMMAND", (sys.executable, "-c", "print(2)"))
    return tmp_path


@pytest.mark.parametrize("device", ["auto", "cuda", "cpu", "cuda:1", "instant:5000", "cuda:0,cuda:2"])
def test_all_gpus_that_cuda_shows_are_used_or_the_named_devices(gpus: Path, device: str) -> None:
    used = "cuda:0,cuda:1" if device in ("auto", "cuda") else device
    assert choose_devices(RenderSettings(device=device)) == tuple(used.split(","))


def test_no_gpu_may_be_named_twice(gpus: Path) -> None:
    with pytest.raises(StartError, match=r"cuda:2 is named twice"):
        choose_devices(RenderSettings(device="cuda:2,cuda:0,cuda:2"))


def test_a_machine_with_one_gpu_is_not_asked_for_more(gpus: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(devices_module, "COUNT_COMMAND", ("/nothing/to/run",))
    (gpus / "nvidia0").unlink()
    (gpus / "nvidia1").unlink()
    assert choose_devices(RenderSettings(device="cuda")) == ("cuda",)


@pytest.mark.parametrize("program", ["raise ImportError('cuda')", "print(0)", "print('none')"])
def test_where_cuda_shows_none_the_engine_says_so(gpus: Path, monkeypatch: pytest.MonkeyPatch, program: str) -> None:
    monkeypatch.setattr(devices_module, "COUNT_COMMAND", (sys.executable, "-c", program))
    assert choose_devices(RenderSettings(device="auto")) == ("auto",)


def test_no_two_devices_are_called_the_same() -> None:
    assert device_names(("instant", "cuda:0", "instant")) == ("instant#0", "cuda:0", "instant#2")


@pytest.mark.parametrize(
    ("cores", "gpus", "edges"),
    [(2, 1, 1), (7, 1, 1), (8, 1, 3), (16, 1, 6), (128, 1, 8), (128, 2, 16), (32, 2, 12), (16, 0, 1)],
)
def test_several_edges_are_for_machines_with_a_gpu_and_cores_to_spare(cores: int, gpus: int, edges: int) -> None:
    assert suggest_edge_count(cores, gpus > 0, max(1, gpus)) == edges


def test_a_kernel_that_cannot_steer_datagrams_gets_one_edge(gpus: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(devices_module, "usable_processors", lambda: 16)
    assert choose_edge_count(RenderSettings(), 2) == 6
    monkeypatch.setattr(devices_module, "attach_steering", lambda *_: False)
    assert choose_edge_count(RenderSettings(), 2) == 1


def test_the_set_number_of_edges_is_taken_where_it_can_be(monkeypatch: pytest.MonkeyPatch) -> None:
    assert choose_edge_count(RenderSettings(edges=3), 1) == 3
    assert choose_edge_count(RenderSettings(edges="auto", device="cpu"), 1) == 1  # type: ignore[arg-type]
    monkeypatch.setattr("sys.platform", "darwin")
    assert choose_edge_count(RenderSettings(edges=1), 1) == 1
    for needs_linux in (
        lambda: choose_edge_count(RenderSettings(edges=2), 1),
        lambda: choose_devices(RenderSettings(device="instant,instant")),
    ):
        with pytest.raises(StartError, match="Linux"):
            needs_linux()


OTHERS = [
    *({"device": given} for given in ("", ",", "cuda:0,", "auto,cpu", "cuda,cuda:1", "cuda:x", "gpu", "instant:9:0")),
    *({"edges": given} for given in ("0", "65", "-1", "two", "1.5")),
]


@pytest.mark.parametrize("given", OTHERS, ids=str)
def test_other_devices_and_numbers_of_edges_are_refused(given: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="device" if "device" in given else "neither auto nor a number from 1 to 64"):
        RenderSettings(**given)
