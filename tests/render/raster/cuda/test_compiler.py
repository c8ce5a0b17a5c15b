"""Kernels compile for every GPU that is supported, once."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.prerequisites import NVRTC
from tigas_render.raster.cuda import compiler


@NVRTC.mark
@pytest.mark.parametrize("arch", ["sm_80", "sm_86", "sm_89", "sm_90", "sm_100", "sm_120"])
def test_the_kernels_compile_for_every_generation_from_ampere_on(arch: str) -> None:
    assert compiler.compile_kernels(arch).startswith(b"\x7fELF")


def test_the_cache_knows_architectures_and_sources_apart(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kernels = tmp_path / "kernels"
    kernels.mkdir()
    (kernels / "a.cu").write_text("one")
    monkeypatch.setattr(compiler, "KERNELS", kernels)
    first = compiler.cached_path("sm_90", tmp_path)
    assert compiler.cached_path("sm_90", tmp_path) == first
    assert compiler.cached_path("sm_80", tmp_path) != first
    (kernels / "a.cu").write_text("two")
    assert compiler.cached_path("sm_90", tmp_path) != first
