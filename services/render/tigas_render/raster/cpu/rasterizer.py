"""The CPU rasteriser, which drives the stages: choose, project, bin, sort and blend."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Any

import numba
import numpy as np
from numpy.typing import DTypeLike, NDArray

from tigas_common.pose import Intrinsics, Pose
from tigas_common.wire.render import FrameFormat
from tigas_render.gaussians import Batches
from tigas_render.raster.base import (
    Camera,
    Pause,
    PreparedScene,
    Rasterizer,
    depth_size,
    inverse_depth,
    one_gaussian,
)
from tigas_render.raster.cpu import layout as L
from tigas_render.raster.cpu.binning import AHEAD, DIGIT, DIGITS, fill_lists, place_lists, sort_lists
from tigas_render.raster.cpu.blend import CELL, TILE_FLOATS, average_cells, blend
from tigas_render.raster.cpu.levels import EDGE_PIXELS, MOST_CHUNKS, MOST_EDGE_PIXELS
from tigas_render.raster.cpu.project import choose_chunks, project
from tigas_render.raster.cpu.scene import CpuScene, pack
from tigas_render.raster.host_image import FramebufferPool, HostImage

SLICES_PER_THREAD = 8
"""Slices of work per thread for projecting and binning: enough to balance the load, few enough to count tiles."""
PAUSE_EVERY_S = 0.003
"""Seconds of drawing between two pauses; if it were much shorter, the cores would wait for each other too often."""
CACHE_LINE = 64
"""Size of a cache line in bytes."""
MAX_ENTRIES = 1 << 24
"""Maximum number of tile list entries held at once. A frame with more is drawn in several bands, to bound memory."""


class Workspace:
    """Named one-dimensional buffers, which grow by at least half of their size and lose their content then."""

    def __init__(self) -> None:
        self._buffers: dict[str, NDArray[Any]] = {}

    def get(self, name: str, size: int, dtype: DTypeLike) -> NDArray[Any]:
        """The first `size` items of the buffer `name`, aligned to a cache line and not cleared."""
        buffer = self._buffers.get(name)
        if buffer is None or buffer.size < size:
            buffer = _aligned(max(size, 3 * buffer.size // 2 if buffer is not None else 0), np.dtype(dtype))
            self._buffers[name] = buffer
        return buffer[:size]


def _aligned(size: int, dtype: np.dtype[Any]) -> NDArray[Any]:
    raw = np.empty(size * dtype.itemsize + CACHE_LINE, np.uint8)
    offset = -raw.ctypes.data % CACHE_LINE
    return raw[offset : offset + size * dtype.itemsize].view(dtype)


@dataclass(slots=True)
class FrameJob:
    """A frame on its way through the stages, as views of the rasteriser's buffers."""

    scene: CpuScene
    image: HostImage
    background: NDArray[np.float32]
    tiles_x: int
    tiles: int
    view: NDArray[np.float64]
    chosen: NDArray[np.int64]
    """The chunks that are drawn."""
    slices: NDArray[np.int64]
    splats: NDArray[np.float32]
    keys: NDArray[np.uint64]
    visible: NDArray[np.int64]
    tile_counts: NDArray[np.int64]
    starts: NDArray[np.int64]
    cells: NDArray[np.float32] | None
    """See `blend.write_cells`; None without depth."""
    begin: int = 0
    end: int = 0
    """Tiles begin … end - 1 are being listed, sorted and drawn; earlier tiles are finished."""
    entries: NDArray[np.uint64] = field(default_factory=lambda: np.empty(0, np.uint64))
    in_order: NDArray[np.uint64] = field(default_factory=lambda: np.empty(0, np.uint64))


class CpuRasterizer(Rasterizer):
    """Renders on all cores that Numba may use (NUMBA_NUM_THREADS). Call `render` from one thread at a time."""

    device = "cpu"
    makes_webp = True
    frames_in_flight = 3  # one is rendered and one encoded, even while another client's large image is encoded

    def __init__(self) -> None:
        self._threads: int = numba.get_num_threads()
        self._workspace, self._other_workspace = Workspace(), Workspace()
        """The workspaces of a frame, and of another frame that is rendered while the first one pauses."""
        self._pool = FramebufferPool()
        self._turn = np.zeros(1, np.int64)

    def pack(self, scene: Batches) -> CpuScene:
        return pack(scene)

    def render(
        self,
        scene: PreparedScene,
        camera: Camera,
        format: FrameFormat = "jpeg",
        pause: Pause | None = None,
        *,
        depth: bool = False,
    ) -> HostImage:
        """Render one view into a framebuffer of the pool, to which closing the image returns it.

        A large scene is drawn at the level of detail that the image's pixels can show, unless full detail is requested.
        """
        assert isinstance(scene, CpuScene)
        job = self.start(scene, camera, 0.0 if camera.full_detail else EDGE_PIXELS, depth=depth)
        self.project(job)
        while job.end < job.tiles:
            self.bin(job)
            self.sort(job)
            if pause is None:
                self.blend(job)
            else:
                self._blend_with_pauses(job, pause)
        if job.cells is not None:
            job.image.depth = _depth(job.cells, job.image.width, job.image.height)
        return job.image

    def _blend_with_pauses(self, job: FrameJob, pause: Pause) -> None:
        """Like `blend`, but a few rows of tiles at a time."""
        end, tiles = job.end, job.tiles_x
        while job.begin < end:
            self._workspace, self._other_workspace = self._other_workspace, self._workspace
            pause()
            self._workspace, self._other_workspace = self._other_workspace, self._workspace
            job.end = min(end, job.begin + tiles)
            begun = time.perf_counter()
            self.blend(job)
            seconds = time.perf_counter() - begun
            job.begin = job.end
            tiles = max(job.tiles_x, int(tiles * min(2.0, PAUSE_EVERY_S / seconds)))

    def warm_up(self) -> None:
        pose = Pose((0.0, 0.0, 0.0), ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)))
        camera = Camera(pose, Intrinsics(16.0, 16.0, 8.0, 8.0, 16, 16))
        for depth in (False, True):
            self.render(self.prepare(one_gaussian()), camera, depth=depth).close()

    # The stages, in order. Benchmarks time them one by one.

    def start(
        self, scene: CpuScene, camera: Camera, edge_pixels: float = EDGE_PIXELS, *, depth: bool = False
    ) -> FrameJob:
        """Choose the visible part of a scene, and allocate a frame's buffers. edge_pixels: see `choose_chunks`."""
        k, get = camera.intrinsics, self._workspace.get
        view = get("view", L.VIEW, np.float64)
        L.fill_view(camera, scene.antialiased, view)
        chosen = self._choose_chunks(scene, view, edge_pixels)
        tiles_x, tiles_y = -(-k.width // L.TILE), -(-k.height // L.TILE)
        parts = max(1, min(len(chosen), self._threads * SLICES_PER_THREAD))
        rows, columns = -(-k.height // CELL), -(-k.width // CELL)
        job = FrameJob(
            scene=scene,
            image=self._pool.image(k.width, k.height),
            background=get("background", 3, np.float32),
            tiles_x=tiles_x,
            tiles=tiles_x * tiles_y,
            view=view,
            chosen=chosen,
            slices=get("slices", parts + 1, np.int64),
            splats=get("splats", len(chosen) * L.CHUNK * L.RECORD, np.float32),
            keys=get("keys", len(chosen) * L.CHUNK + AHEAD, np.uint64),
            visible=get("visible", len(chosen), np.int64),
            tile_counts=get("tile_counts", parts * tiles_x * tiles_y, np.int64).reshape(parts, -1),
            starts=get("starts", tiles_x * tiles_y + 1, np.int64),
            cells=get("cells", rows * columns * 2, np.float32).reshape(rows, columns, 2) if depth else None,
        )
        job.background[:] = camera.background
        job.slices[:] = np.arange(parts + 1) * len(chosen) // parts
        return job

    def _choose_chunks(self, scene: CpuScene, view: NDArray[np.float64], edge_pixels: float) -> NDArray[np.int64]:
        """The visible chunks, with less detail if there are too many, unless full detail is requested."""
        nodes, chosen = scene.nodes, self._workspace.get("chosen", len(scene.bounds), np.int64)
        while True:
            count = choose_chunks(nodes.chunks, nodes.edges, nodes.bounds, view, edge_pixels, chosen)
            if count <= MOST_CHUNKS or not 0 < edge_pixels < MOST_EDGE_PIXELS:
                return chosen[:count]
            edge_pixels *= 1.2

    def project(self, job: FrameJob) -> None:
        """Cull, project and shade Gaussians, and count the tiles that each one touches."""
        scene, projected = job.scene, self._per_thread("projected", L.USED * L.CHUNK, np.float32)
        project(
            scene.geometry.reshape(-1), scene.sh.reshape(-1).view(np.uint16), scene.bounds, job.chosen, job.view,
            job.splats, job.keys, job.visible, job.slices, job.tile_counts, job.tiles_x, projected, self._counter(0),
        )  # fmt: skip

    def bin(self, job: FrameJob) -> None:
        """List the Gaussians of each tile, from the first unfinished tile on, up to MAX_ENTRIES."""
        job.begin = job.end
        job.end = place_lists(job.tile_counts, job.begin, MAX_ENTRIES, job.starts)
        total = int(job.starts[job.end])
        job.entries = self._workspace.get("entries", total, np.uint64)
        job.in_order = self._workspace.get("entries in order", total, np.uint64)
        fill_lists(
            job.splats, job.keys, job.visible, job.slices, job.tile_counts, job.tiles_x, job.begin, job.end,
            job.entries, self._threads, self._counter(0),
        )  # fmt: skip

    def sort(self, job: FrameJob) -> None:
        histograms = self._per_thread("histograms", DIGITS << DIGIT, np.int64)
        turn = self._counter(job.begin)
        sort_lists(job.starts, job.begin, job.end, job.entries, job.in_order, histograms, turn)

    def blend(self, job: FrameJob) -> None:
        accumulators = self._per_thread("accumulators", TILE_FLOATS, np.float32)
        blend(
            job.splats, job.starts, job.begin, job.end, job.in_order, job.background, job.image.to_host(), job.cells,
            accumulators, self._counter(job.begin),
        )  # fmt: skip

    def _per_thread(self, name: str, size: int, dtype: Any) -> NDArray[Any]:
        return self._workspace.get(name, self._threads * size, dtype).reshape(self._threads, size)

    def _counter(self, first: int) -> NDArray[np.int64]:
        self._turn[0] = first
        return self._turn


def _depth(cells: NDArray[np.float32], width: int, height: int) -> NDArray[np.float32]:
    """The inverse depth of an image, from its cells."""
    columns, rows = depth_size(width, height)
    means = np.empty((rows, columns, 2), np.float32)
    average_cells(cells, width, height, means)
    return inverse_depth(means)
