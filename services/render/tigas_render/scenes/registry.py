"""The scenes of the service: available, loaded and in use.

All methods must be called on one event loop; only reading files and packing scenes happen in worker threads.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from types import TracebackType

from tigas_common.errors import BrokenScene, NoRoom, OutOfDeviceMemory, SceneInUse, TigasError, UnknownScene
from tigas_common.wire.render import SceneInfo
from tigas_render.gaussians import Batches
from tigas_render.raster.base import PreparedScene
from tigas_render.scenes.coarse import CoarseSceneCache
from tigas_render.scenes.demo import DEMO_SOURCE
from tigas_render.scenes.directory import scan_directory
from tigas_render.scenes.entry import Entry, LoadedScene, LoadingEnded
from tigas_render.scenes.source import SceneSource
from tigas_render.scenes.start_view.statistics import SceneStatistics
from tigas_render.scenes.start_view.view import StartView, StartViewCache, view_from_metadata

_log = logging.getLogger(__name__)

BUILTIN: Mapping[str, SceneSource] = {DEMO_SOURCE.id: DEMO_SOURCE}
"""Scenes that are part of the package. A scene with the same id in the models directory replaces them."""
COARSE_SAMPLE = 12_500
"""Number of Gaussians from which a coarse scene's start view is derived; takes half a second."""
MAX_CONCURRENT_READS = 2
"""Number of scenes read at a time, each of which occupies a worker thread for long; the same for coarse scenes."""
IN_USE_S = 30.0
"""Seconds for which a scene counts as in use after its last frame, because a viewer may just be standing still."""


class SceneRegistry:
    """Loads scenes on first use, and keeps them until they have been idle for long or others need the memory.

    pack: packs a scene for the rasteriser while it is read; called in a worker thread. own_ladders: whether scenes keep
    their own ladders. views, coarse: caches of derived start views and of coarse scenes. memory_budget: limit of all
    prepared scenes together, in bytes. idle_s: seconds without use after which `evict_idle` unloads a scene. clock:
    returns seconds.
    """

    def __init__(
        self,
        directory: Path | None,
        pack: Callable[[Batches], PreparedScene],
        *,
        builtin: Mapping[str, SceneSource] = BUILTIN,
        own_ladders: bool = True,
        views: StartViewCache | None = None,
        coarse: CoarseSceneCache | None = None,
        memory_budget: int,
        idle_s: float,
        clock: Callable[[], float],
    ) -> None:
        self._directory = directory
        self._pack = pack
        self._builtin = builtin
        self._own_ladders = own_ladders
        self._views = views
        self._coarse = coarse
        self.budget = memory_budget
        """Limit of all loaded scenes together, in bytes."""
        self._idle_s = idle_s
        self._clock = clock
        self._entries = {id: Entry(source) for id, source in self._apply_ladder_setting(builtin).items()}
        self._retired: set[Entry] = set()  # removed from the directory or replaced there, but still in use
        self._read_limit = asyncio.Semaphore(MAX_CONCURRENT_READS)
        self._coarse_read_limit = asyncio.Semaphore(MAX_CONCURRENT_READS)
        self._scan_lock = asyncio.Lock()
        self._scans_requested = self._scans_done = 0
        self._closed = False

    async def scan(self) -> None:
        """Rescan the models directory, to add and remove scenes and to retry changed and broken ones.

        A loaded scene stays loaded while its file is unchanged or cannot be read, and all scenes stay if the directory
        cannot be read. Scans run one at a time, so that an older listing never replaces a newer one; concurrent callers
        share the next scan.
        """
        self._scans_requested += 1
        asked = self._scans_requested
        async with self._scan_lock:
            if self._scans_done < asked:
                started = self._scans_requested
                try:
                    self._update_entries(*await asyncio.to_thread(self._read_directory))
                except OSError as error:
                    _log.warning("%s cannot be read: %s", self._directory, error.strerror or error)
                self._scans_done = started

    def _read_directory(self) -> tuple[Mapping[str, SceneSource], Mapping[str, StartView]]:
        """The scenes of the directory, and their start views as far as known. Runs in a worker thread."""
        found = scan_directory(self._directory) if self._directory else {}
        views = {id: self._cached_view(source) for id, source in found.items()}
        return found, {id: view for id, view in views.items() if view is not None}

    def _cached_view(self, source: SceneSource) -> StartView | None:
        return view_from_metadata(source.metadata) or (self._views.read(source) if self._views else None)

    def _update_entries(self, found: Mapping[str, SceneSource], views: Mapping[str, StartView]) -> None:
        """Offer the scan's scenes and the built-in ones."""
        old = self._entries
        self._entries = {}
        for id, source in sorted(self._apply_ladder_setting({**self._builtin, **found}).items()):
            entry = old.pop(id, None)
            if entry is not None and entry.source.version == source.version and not (entry.error or source.error):
                entry.source, entry.view = source, views.get(id) or _with_new_up(entry.view, source)
                if entry.loaded is not None:
                    entry.loaded = replace(entry.loaded, source=source, view=entry.view or entry.loaded.view)
                self._entries[id] = entry
                continue
            if entry is not None and entry.loaded is not None and _is_possibly_same(entry.source, source):
                _log.warning("%s stays loaded, unchanged: %s", id, source.error)
                self._entries[id] = entry
                continue
            if entry is not None:
                self._retire(entry)
            self._entries[id] = entry = Entry(source)
            entry.view = views.get(id) or entry.view
        for entry in old.values():
            self._retire(entry)

    def _apply_ladder_setting(self, sources: Mapping[str, SceneSource]) -> Mapping[str, SceneSource]:
        if self._own_ladders:
            return sources
        return {id: replace(source, ladder=None) for id, source in sources.items()}

    def scene_infos(self) -> list[SceneInfo]:
        """All scenes, sorted by id, without saved views and paths, because there may be many."""
        left_out: Mapping[str, object] = {"views": {}, "paths": {}}
        return [self._entry_info(entry).model_copy(update=left_out) for entry in self._entries.values()]

    def memory(self) -> dict[str, int]:
        """Memory of loaded and loading scenes in bytes by id, including removed scenes that are still in use."""
        taken: dict[str, int] = {}
        for entry in (*self._entries.values(), *self._retired):
            if entry.reserved:
                taken[entry.source.id] = taken.get(entry.source.id, 0) + entry.reserved
        return taken

    def has(self, scene_id: str) -> bool:
        return scene_id in self._entries

    def scene_info(self, scene_id: str) -> SceneInfo:
        """One scene. Raises UnknownScene."""
        return self._entry_info(self._entry(scene_id))

    def source(self, scene_id: str) -> SceneSource:
        """A scene's source. Raises UnknownScene."""
        return self._entry(scene_id).source

    def use(self, scene_id: str, *, coarse: bool = False) -> SceneUse:
        """A context manager that holds the scene in memory: `async with registry.use(id) as loaded`.

        coarse: accept the coarse scene while the scene itself loads. Entering loads the scene if necessary, and is
        cheap otherwise. It raises UnknownScene, BrokenScene, and NoRoom if scenes in use leave no room for it.
        """
        return SceneUse(self, scene_id, coarse=coarse)

    async def load(self, scene_id: str, *, coarse: bool = False) -> None:
        """Load a scene, even if it was broken before. Raises the same errors as `use`.

        coarse: wait only until the coarse scene is available.
        """
        if self._entry(scene_id).error is not None:
            await self.scan()
        async with SceneUse(self, scene_id, coarse=coarse):
            self._entry(scene_id).unload_when_unused = False

    def mark_viewed(self, scene_id: str) -> None:
        """Note that a viewer has received a frame of this scene. Unknown ids are ignored."""
        if (entry := self._entries.get(scene_id)) is not None:
            entry.last_viewed = self._clock()

    def unload(self, scene_id: str) -> None:
        """Release a scene's memory; if it is loading, that is aborted soon.

        Raises SceneInUse, because no viewer may take a scene away from another, and UnknownScene.
        """
        entry = self._entry(scene_id)
        if entry.users or self._clock() - entry.last_viewed < IN_USE_S:
            raise SceneInUse(
                f"{entry.source.name} is in use, or was less than {IN_USE_S:.0f} seconds ago; unload it once nobody"
                " views it."
            )
        entry.unload_when_unused = True
        self._unload_if_unused(entry)

    def evict(self) -> bool:
        """Unload the least recently used scene that is not in use; False if there is no such scene."""
        victims = [entry for entry in self._entries.values() if entry.loaded and not entry.users]
        if not victims:
            return False
        victim = min(victims, key=lambda entry: entry.last_used)
        _log.info("Unloaded %s: the device's memory is full", victim.source.id)
        self._unload(victim)
        return True

    def evict_idle(self, now: float) -> None:
        """Unload all scenes that have been idle for too long."""
        for entry in self._entries.values():
            if entry.loaded and not entry.users and now - entry.last_used >= self._idle_s:
                _log.info("Unloaded %s: unused for %.0f s", entry.source.id, now - entry.last_used)
                self._unload(entry)

    def close(self) -> None:
        """Abort all loading, even of awaited scenes, because the service is stopping."""
        self._closed = True

    async def _acquire(self, scene_id: str, *, coarse: bool) -> tuple[Entry, LoadedScene]:
        entry = self._entry(scene_id)
        entry.users += 1
        try:
            while (scene := entry.available(coarse=coarse)) is None:
                await self._wait_until_loaded(entry, coarse=coarse)
        except BaseException:
            self._release(entry)
            raise
        return entry, scene

    async def _wait_until_loaded(self, entry: Entry, *, coarse: bool) -> None:
        if entry.error is not None:
            raise BrokenScene(entry.error)
        if entry.loading is None:
            entry.coarse_settled.clear()
            entry.loading = asyncio.create_task(self._load(entry), name=f"load {entry.source.id}")
        loading = entry.loading
        if coarse:
            await entry.coarse_settled.wait()
            if entry.coarse is not None:
                return
        # shielded, because a cancelled waiter must not cancel loading for the others
        error = await asyncio.shield(loading)
        if isinstance(error, LoadingEnded) and not self._closed:
            return  # it was unloaded in the meantime
        if error is not None:
            raise type(error)(error.detail)

    def _release(self, entry: Entry) -> None:
        entry.users -= 1
        entry.last_used = self._clock()
        self._unload_if_unused(entry)

    async def _load(self, entry: Entry) -> TigasError | None:
        """Load an entry; errors are returned, because no waiter may be left to catch them."""
        source, entry.progress = entry.source, 0.0
        try:
            self._reserve_memory(entry, source.memory_bytes)
            async with self._coarse_read_limit:
                entry.coarse = await asyncio.to_thread(self._read_coarse, entry)
            if entry.coarse is not None:
                entry.view = entry.view or entry.coarse.view
            entry.coarse_settled.set()
            entry.is_queued = True
            async with self._read_limit:
                entry.is_queued = False
                self._check_wanted(entry)
                self._reserve_memory(entry, source.memory_bytes)  # again, as a queued entry may lose its reservation
                loaded = await self._read_or_evict(entry)
                self._reserve_memory(entry, loaded.prepared.nbytes)
                self._check_wanted(entry)
                if source.digest is not None:
                    entry.sha256 = await asyncio.to_thread(source.digest)
        except Exception as error:
            return self._record_failure(entry, error)
        else:
            # a scan may have changed the metadata meanwhile
            view = view_from_metadata(entry.source.metadata) or _with_new_up(loaded.view, entry.source) or loaded.view
            entry.loaded = replace(loaded, source=entry.source, view=view)
            entry.view, entry.last_used = view, self._clock()
            _log.info("Loaded %s: %d Gaussians, %.1f MB", source.id, loaded.gaussians, loaded.prepared.nbytes / 1e6)
            return None
        finally:
            entry.loading = entry.coarse = None
            entry.is_queued = False
            entry.coarse_settled.set()
            self._unload_if_unused(entry)

    def _record_failure(self, entry: Entry, error: Exception) -> TigasError:
        """Record why an entry was not loaded, and return the error for its waiters."""
        name = entry.source.name
        if isinstance(error, OSError):  # the file was renamed or removed meanwhile
            error = BrokenScene(f"{name} cannot be read: {error.strerror or error}.")
        elif not isinstance(error, TigasError):
            _log.error("%s was not loaded", entry.source.id, exc_info=error)
            error = BrokenScene(f"{name} could not be loaded; the server's log says why.")
        if isinstance(error, BrokenScene):
            entry.error = error.detail
        entry.reserved = 0
        _log.warning("%s was not loaded: %s", entry.source.id, error.detail)
        return error

    async def _read_or_evict(self, entry: Entry) -> LoadedScene:
        """Read a scene; if the device's memory is full, retry once after unloading another."""
        try:
            return await asyncio.to_thread(self._read, entry)
        except OutOfDeviceMemory:
            if not self.evict():
                raise
        return await asyncio.to_thread(self._read, entry)  # outside `except`, as the error references the allocations

    def _read_coarse(self, entry: Entry) -> LoadedScene | None:
        """The coarse scene of a large scene, if available. Runs in a worker thread."""
        source, statistics = entry.source, SceneStatistics(COARSE_SAMPLE)
        try:
            file = self._coarse.read(source) if self._coarse else None
            if file is None:
                return None
            scene = statistics.collect(file.open(lambda _: self._check_wanted(entry)))
            prepared = self._pack(scene)
        except (BrokenScene, OSError, OutOfDeviceMemory) as error:
            _log.warning("%s cannot be shown while it loads: %s", source.id, error)
            return None
        view = entry.view or self._cached_view(source) or statistics.view(source.metadata)
        return LoadedScene(source, prepared, statistics.count, view, is_coarse=True)

    def _read(self, entry: Entry) -> LoadedScene:
        """Read a scene's file and pack it for the rasteriser. Runs in a worker thread."""
        source, statistics = entry.source, SceneStatistics()

        def listen(progress: float) -> None:
            entry.progress = progress
            self._check_wanted(entry)

        try:
            scene = statistics.collect(source.read(listen))
            prepared = self._pack(replace(scene, check=lambda: self._check_wanted(entry)))
        except OutOfDeviceMemory as error:
            raise error.with_traceback(None) from None  # the traceback would keep the allocations alive
        view = self._cached_view(source)
        if view is None:
            view = statistics.view(source.metadata)
            if self._views is not None:
                self._views.write(source, view)
        if self._coarse is not None and entry.coarse is None:
            self._coarse.write(source, statistics)
        return LoadedScene(source, prepared, statistics.count, view)

    def _check_wanted(self, entry: Entry) -> None:
        """Raise LoadingEnded if loading an entry has become pointless. May be called in a worker thread."""
        if self._closed:
            raise LoadingEnded(f"{entry.source.name} was not loaded, as the service is stopping.")
        if entry.unload_when_unused and not entry.users:
            raise LoadingEnded(f"{entry.source.name} was unloaded while it was loading.")

    def _reserve_memory(self, entry: Entry, needed: int) -> None:
        """Reserve `needed` bytes, evicting unused scenes, least recently used first. Raises BrokenScene and NoRoom."""
        if needed > self.budget:
            raise BrokenScene(
                f"{entry.source.name} takes {needed / 1e6:.1f} MB in memory, and all scenes together may take"
                f" {self.budget / 1e6:.1f} MB."
            )
        others = {other for other in (*self._entries.values(), *self._retired) if other is not entry}
        excess = sum(other.reserved for other in others) + needed - self.budget
        victims = sorted((o for o in others if o.loaded and not o.users), key=lambda other: other.last_used)
        if sum(other.reserved for other in victims) < excess:
            raise NoRoom(
                f"There is no room for {entry.source.name} ({needed / 1e6:.1f} MB) next to the scenes in use; try "
                "again later."
            )
        for victim in victims:
            if excess <= 0:
                break
            excess -= victim.reserved
            _log.info("Unloaded %s to make room for %s", victim.source.id, entry.source.id)
            self._unload(victim)
        entry.reserved = needed

    def _retire(self, entry: Entry) -> None:
        entry.unload_when_unused = True
        self._retired.add(entry)
        self._unload_if_unused(entry)

    def _unload_if_unused(self, entry: Entry) -> None:
        if not entry.unload_when_unused or entry.users:
            return
        if entry.loading is None:
            self._unload(entry)
        elif entry.is_queued:
            entry.reserved = 0

    def _unload(self, entry: Entry) -> None:
        entry.loaded, entry.reserved, entry.unload_when_unused = None, 0, False
        self._retired.discard(entry)

    def _entry(self, scene_id: str) -> Entry:
        try:
            return self._entries[scene_id]
        except KeyError:
            raise UnknownScene(f"There is no scene {scene_id[:100]!r}.") from None

    def _entry_info(self, entry: Entry) -> SceneInfo:
        builtin = self._builtin.get(entry.source.id)
        return entry.info(builtin=builtin is not None and builtin.version == entry.source.version)


class SceneUse:
    """Holds a scene in memory, as a context manager, or from `enter` or `enter_if_loaded` until `leave`."""

    __slots__ = ("_coarse", "_entry", "_registry", "_scene_id")

    def __init__(self, registry: SceneRegistry, scene_id: str, *, coarse: bool) -> None:
        self._registry = registry
        self._scene_id = scene_id
        self._coarse = coarse

    def enter_if_loaded(self) -> LoadedScene | None:
        """The scene; None if it must be loaded first. Raises UnknownScene."""
        entry = self._registry._entry(self._scene_id)
        scene = entry.available(coarse=self._coarse)
        if scene is not None:
            entry.users += 1
            self._entry = entry
        return scene

    async def enter(self) -> LoadedScene:
        """The scene, loaded if necessary. Raises the same errors as `SceneRegistry.use`."""
        self._entry, loaded = await self._registry._acquire(self._scene_id, coarse=self._coarse)
        return loaded

    def leave(self) -> None:
        """Allow the scene to be unloaded again."""
        self._registry._release(self._entry)

    async def __aenter__(self) -> LoadedScene:
        return await self.enter()

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.leave()


def _is_possibly_same(before: SceneSource, now: SceneSource) -> bool:
    """Whether a scene that cannot be read now may be unchanged: its main file is, or could not be read either."""
    return now.is_unread and before.version.startswith(now.version)


def _with_new_up(view: StartView | None, source: SceneSource) -> StartView | None:
    """A scene's previous view, with the up axis of its metadata, if any."""
    up = source.metadata.up
    return view if view is None or up is None else view.model_copy(update={"up": up})
