"""Compiles the CUDA C++ in `kernels` with NVRTC, once per architecture, and caches the result on disk."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from tigas_render.local_files import write_to_cache
from tigas_render.raster.cuda.scene import CHUNK

if TYPE_CHECKING:
    from cuda.core import Device, Kernel, LaunchConfig, ObjectCode

KERNELS = Path(__file__).parent / "kernels"
"""Directory of the sources: kernels in `.cu` files, and shared code in `.cuh` files."""
MAX_RANGES = 1024
"""Maximum number of blocks of the kernel `begin`, as in frame.cuh."""


@dataclass(frozen=True, slots=True)
class Stage:
    """A kernel of a frame, and its launch configuration. Every grid fits on the device at once."""

    name: str
    kernel: Kernel
    config: LaunchConfig


def load_kernels(arch: str, cache: Path) -> ObjectCode:
    """Load the kernels for an architecture such as `sm_90` from the cache directory, or compile and cache them.

    Raises cuda.core's RuntimeError if the sources do not compile. It is not an error if the cache cannot be written.
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
    """Compile the kernels to machine code for an architecture. Does not need a GPU."""
    from cuda.core import Program, ProgramOptions

    units = "".join(f'#include "{path.name}"\n' for path in sorted(KERNELS.glob("*.cu")))
    options = ProgramOptions(name="tigas.cu", arch=arch, std="c++17", use_fast_math=True, include_path=str(KERNELS))
    return bytes(Program(units, "c++", options).compile("cubin").code)


def cached_path(arch: str, cache: Path) -> Path:
    """The cache file of the machine code, with a name that depends on the architecture and the sources."""
    digest = hashlib.sha256(Path(__file__).read_bytes())  # this file has the compiler options
    for path in sorted(KERNELS.iterdir()):
        digest.update(path.name.encode() + b"\0" + path.read_bytes())
    return cache / f"cuda-{arch}-{digest.hexdigest()[:16]}.cubin"


def make_stages(device: Device, kernels: dict[str, Kernel], side: int) -> tuple[Stage, ...]:
    """The kernels of a frame in order, for tiles of this side length in pixels."""
    from cuda.core import LaunchConfig

    processors = device.properties.multiprocessor_count

    def stage(name: str, kernel: Kernel, threads: int) -> Stage:
        blocks = kernel.occupancy.max_active_blocks_per_multiprocessor(threads, 0)
        return Stage(name, kernel, LaunchConfig(grid=processors * blocks, block=threads))

    return (
        Stage("begin", kernels["begin"], LaunchConfig(grid=min(2 * processors, MAX_RANGES), block=CHUNK)),
        stage("project", kernels[f"project_{side}"], CHUNK),
        stage("large", kernels[f"large_{side}"], CHUNK),
        stage("place", kernels["place"], CHUNK),
        stage("bin", kernels[f"bin_{side}"], CHUNK),
        stage("blend", kernels[f"blend_{side}"], 256),
    )
