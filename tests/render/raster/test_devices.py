"""The choice of the rendering device, and its description."""

from __future__ import annotations

from pathlib import Path

import pytest

from tigas_render.raster import devices
from tigas_render.raster.devices import create_rasterizer


@pytest.fixture(autouse=True)
def no_cuda(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A machine on which CUDA cannot be used; its programs are those in `tmp_path`."""
    monkeypatch.setattr(devices, "why_no_cuda", lambda: "The packages are missing.")
    monkeypatch.setenv("PATH", str(tmp_path))


def test_with_nvidias_driver_auto_says_why_it_renders_on_the_cpu(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "nvidia-smi").touch(mode=0o755)
    assert create_rasterizer("auto").device == "cpu"
    assert caplog.messages == ["Rendering on the CPU. The packages are missing."]


def test_without_a_gpu_auto_says_nothing(caplog: pytest.LogCaptureFixture) -> None:
    assert create_rasterizer("auto").device == "cpu"
    assert caplog.messages == []


def test_who_chooses_the_cpu_is_told_nothing(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    (tmp_path / "nvidia-smi").touch(mode=0o755)
    assert create_rasterizer("cpu").device == "cpu"
    assert caplog.messages == []
