"""Compiles the CUDA C++ in `kernels` through NVRTC, once for each architecture, and keeps the result on disk."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import TYPE_CHECKING

from tigas_render.cache import write_to_cache

if TYPE_CHECKING:
    from cuda.core import ObjectCode

KERNELS = Path(__file__).parent / "kernels"
"""Directory of the sources: `.cu` files have kernels, `.cuh` files shared code."""


def load_kernels(arch: str, cache: Path) -> ObjectCode:
    """The kernels for an architecture such as `sm_90`, from the cache directory if they are there, else compiled.

    Raises RuntimeError, from cuda.core, if the sources do not compile. A cache that cannot be written is no error.
    """
    from cuda.core import ObjectCode

    path = cached_path(arch, cache)
    try:
        return ObjectCode.from_cubin(path.read_bytes())
    except OSError:
        cubin = compile_kernels(arch)
    write_to_cache(path, cubin)
    return ObjectCode.from_cubin(cubin)


def compile_kernels(arch: str) -> bytes:
    """Machine code for an architecture; needs no GPU."""
    from cuda.core import Program, ProgramOptions

    units = "".join(f'#include "{path.name}"\n' for path in sorted(KERNELS.glob("*.cu")))
    options = ProgramOptions(name="tigas.cu", arch=arch, std="c++17", use_fast_math=True, include_path=str(KERNELS))
    return bytes(Program(units, "c++", options).compile("cubin").code)


def cached_path(arch: str, cache: Path) -> Path:
    """Where the machine code is kept: another source or architecture has another name."""
    digest = hashlib.sha256(Path(__file__).read_bytes())  # the options are sources too
    for path in sorted(KERNELS.iterdir()):
        digest.update(path.name.encode() + b"\0" + path.read_bytes())
    return cache / f"cuda-{arch}-{digest.hexdigest()[:16]}.cubin"
