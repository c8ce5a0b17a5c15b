"""Compiling and caching of kernels, and primitives that Numba lacks: an atomic counter, prefetching and bit casts."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call,untyped-decorator,call-arg,var-annotated"
from __future__ import annotations

import hashlib
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.core.caching import FunctionCache, IndexDataCacheFile
from numba.extending import intrinsic

from tigas_render.raster import base


def _fingerprint() -> str:
    files = [*sorted(Path(__file__).parent.glob("*.py")), Path(base.__file__)]
    return hashlib.sha256(b"\0".join(file.read_bytes() for file in files)).hexdigest()


FINGERPRINT = _fingerprint()
"""Digest of the sources of all kernels."""


class _KernelCache(FunctionCache):
    """Numba's cache on disk, invalidated by a change in any module of this package.

    Numba itself checks only a function's own file, and would keep outdated code inlined from others. It also ignores
    kernels next to their sources if the user cannot write there, such as an unprivileged service.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        name, next_to_sources = self._impl.filename_base, Path(function.__code__.co_filename).parent / "__pycache__"
        self._cache_file = IndexDataCacheFile(self._cache_path, name, FINGERPRINT)
        self._installed = IndexDataCacheFile(str(next_to_sources), name, FINGERPRINT)

    def _load_overload(self, sig: Any, target_context: Any) -> Any:
        own = super()._load_overload(sig, target_context)
        if own is not None:
            return own
        with suppress(OSError):  # not readable by this user
            installed = self._installed.load(self._index_key(sig, target_context.codegen()))
            if installed is not None:
                return self._impl.rebuild(target_context, installed)
        return None


def kernel(*, parallel: bool = False, inline: bool = False, exact: bool = False) -> Callable[[Callable[..., Any]], Any]:
    """Compile a function to run without the GIL, and cache it. Kernels may test for NaN and infinities.

    exact: follow IEEE 754 to the last bit, so that the result is the same wherever the function is inlined.
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


@intrinsic
def fetch_add(typingctx, counters, index):
    """Atomically add 1 to counters[index] and return the old value, to hand out work to threads as they become free."""

    def codegen(context, builder, signature, args):
        array = context.make_array(signature.args[0])(context, builder, args[0])
        pointer = cgutils.gep(builder, array.data, args[1])
        return builder.atomic_rmw("add", pointer, ir.Constant(ir.IntType(64), 1), "monotonic")

    return types.int64(counters, index), codegen


@intrinsic
def prefetch(typingctx, array, index):
    """Prefetch the cache line of array[index] (one-dimensional), which will be read soon."""

    def codegen(context, builder, signature, args):
        data = context.make_array(signature.args[0])(context, builder, args[0]).data
        pointer = builder.bitcast(cgutils.gep(builder, data, args[1]), ir.IntType(8).as_pointer())
        hint = ir.FunctionType(ir.VoidType(), [pointer.type, *[ir.IntType(32)] * 3])
        function = cgutils.get_or_insert_function(builder.module, hint, "llvm.prefetch.p0")
        read, keep, data_cache = (ir.Constant(ir.IntType(32), value) for value in (0, 3, 1))
        builder.call(function, [pointer, read, keep, data_cache])
        return context.get_dummy_value()

    return types.void(array, index), codegen


@intrinsic
def bits_of(typingctx, value):
    """The bits of a float32, as uint32."""

    def codegen(context, builder, signature, args):
        return builder.bitcast(args[0], ir.IntType(32))

    return types.uint32(types.float32), codegen


@intrinsic
def widen(typingctx, bits):
    """Convert a float16, given by its bits (uint16), to float32."""

    def codegen(context, builder, signature, args):
        return builder.fpext(builder.bitcast(args[0], ir.HalfType()), ir.FloatType())

    return types.float32(types.uint16), codegen


@intrinsic
def float_of(typingctx, value):
    """The float32 with these bits (uint32)."""

    def codegen(context, builder, signature, args):
        return builder.bitcast(args[0], ir.FloatType())

    return types.float32(types.uint32), codegen
