"""The choice of the rendering device, and its description."""

from __future__ import annotations

from pathlib import Path

import pytest

from tigas_render.raster import devices
from tigas_render.raster.devices import create_rasterizer


@pytest.fixture(autouse=True)
def no_cuda(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A machine on which CUDA cannot be used; its programs are those in `tmp_path`."""
    monkeypatch.setattr(devices, "cuda_problem", lambda: "The packages are missing.")
    monkeypatch.setenv("PATH", str(tmp_path))


@pytest.mark.parametrize(
    ("device", "driver", "messages"),
    [
        ("auto", True, ["Rendering on the CPU. The packages are missing."]),
        ("auto", False, []),
        ("cpu", True, []),
    ],
    ids=["a GPU that cannot be used", "no GPU", "chosen"],
)
def test_only_who_may_expect_a_gpu_is_told_why_the_cpu_renders(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, device: str, driver: bool, messages: list[str]
) -> None:
    if driver:
        (tmp_path / "nvidia-smi").touch(mode=0o755)
    assert create_rasterizer(device).device == "cpu"
    assert caplog.messages == messages
