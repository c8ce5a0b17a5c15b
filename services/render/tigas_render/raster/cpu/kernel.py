"""How the kernels are compiled and cached."""

# mypy: disable-error-code="no-untyped-call"
from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

from numba import njit
from numba.core.caching import FunctionCache, IndexDataCacheFile

from tigas_render.raster import base


def _fingerprint() -> str:
    files = [*sorted(Path(__file__).parent.glob("*.py")), Path(base.__file__)]
    return hashlib.sha256(b"\0".join(file.read_bytes() for file in files)).hexdigest()


FINGERPRINT = _fingerprint()
"""Digest of the sources of all kernels."""


class _KernelCache(FunctionCache):
    """Numba's cache on disk, invalidated by a change in any module of this package.

    Numba itself checks only a function's own file, and would keep code inlined from others.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        self._cache_file = IndexDataCacheFile(self._cache_path, self._impl.filename_base, FINGERPRINT)


def kernel(*, parallel: bool = False, inline: bool = False, exact: bool = False) -> Callable[[Callable[..., Any]], Any]:
    """Compile a function to run without the GIL, and cache it. Kernels may test for NaN and infinities.

    exact: follow IEEE 754 to the last bit, so that the function gives the same wherever it becomes part of another.
    """

    def compile_(function: Callable[..., Any]) -> Any:
        compiled: Any = njit(
            parallel=parallel,
            inline="always" if inline else "never",
            nogil=True,
            error_model="numpy",
            fastmath=False if exact else {"contract", "nsz", "arcp", "afn"},
        )(function)
        compiled._cache = _KernelCache(function)
        return compiled

    return compile_
