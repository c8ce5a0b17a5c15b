"""Kernels are compiled once for all users of an installation."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

MODULE = """
from tigas_render.raster.cpu.kernel import kernel

@kernel()
def one_more(x):
    return x + 1

print(one_more(1), sum(one_more.stats.cache_hits.values()))
"""


def run(module: Path, **environment: str) -> str:
    done = subprocess.run([sys.executable, module], env={**os.environ, **environment}, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.extended
def test_a_user_with_another_cache_takes_kernels_from_next_to_their_sources(tmp_path: Path) -> None:
    module, other = tmp_path / "module.py", tmp_path / "other"
    module.write_text(MODULE)
    assert run(module) == "2 0\n"
    assert run(module, NUMBA_CACHE_DIR=str(other)) == "2 1\n"
    assert not list(other.rglob("module*.nbc"))
