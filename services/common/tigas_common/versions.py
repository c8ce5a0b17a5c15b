"""Supported versions of the packages whose private names are used; another minor version may have renamed them.

Upstream could accept these as patches, after which the private uses can go:

- aioquic: a receive window that grows, a limit on the size of header sections, congestion control that ignores
  application-limited rounds, and sending packets in batches;
- uvicorn: limits on connections per client, on the time that headers and bodies take, and a hook for refused ones;
- aiortc: bit-rate limits of its encoders as arguments, and complete checks of an offer;
- aioice: one UDP port for several connections;
- cuda-core: a public name for `CUDAError`.
"""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, version

from tigas_common.errors import StartError

SUPPORTED = {
    "aioice": ("0.13", "0.14"),
    "aioquic": ("1.7", "1.8"),
    "aiortc": ("1.16", "1.17"),
    "cuda-core": ("1.0", "1.3"),
    "uvicorn": ("0.35", "0.55"),
}
"""The first minor version that is supported, and the first that is not, as in pyproject.toml."""


def check_versions(*packages: str) -> None:
    """Raise StartError if an unsupported version of a package is installed. Call it before the package is imported."""
    for package in packages:
        try:
            installed = version(package)
        except PackageNotFoundError:
            continue  # imports report missing packages
        first, end = SUPPORTED[package]
        if not _numbers(first) <= _numbers(installed) < _numbers(end):
            needed = f"{package}>={first},<{end}"
            raise StartError(f"{package} {installed} is installed, but TIGAS needs {needed}: pip install '{needed}'.")


def _numbers(text: str) -> tuple[int, ...]:
    """The major and the minor version."""
    return tuple(int(part) for part in text.split(".")[:2])
