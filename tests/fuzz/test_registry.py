"""Scenes appear, disappear, break and are used in any order: each load is correct, and no unused scene stays."""

from __future__ import annotations

import asyncio
import contextlib
import shutil
import tempfile
from pathlib import Path

from hypothesis import strategies as st
from hypothesis.stateful import Bundle, RuleBasedStateMachine, consumes, invariant, rule

from tests.fuzz.fuzzers import assert_sentence, effort
from tests.render.scenes import plys
from tests.render.scenes.registry_bench import Bench
from tigas_common.errors import BrokenScene, Overloaded, UnknownScene
from tigas_render.scenes.registry import SceneUse

BUDGET = 1000
"""Bytes; a Gaussian takes one here."""
FILES = (
    *(plys.binary_ply(1), plys.binary_ply(2), plys.ascii_ply(3), plys.binary_ply(500)),
    *(b"", b"ply\n", plys.binary_ply(3)[:-1], plys.header(plys.names(0), 10**12), plys.header(plys.names(0), 2000)),
)  # fmt: skip
DESCRIPTIONS = (b"{}", b'{"name": "x"}', b'{"up": [0, 0, 1]}', b"{", b"\xff", b'{"name": ""}')
ids = st.sampled_from(("a", "b", "c", "nowhere"))


class RegistryMachine(RuleBasedStateMachine):
    """A registry over a directory with concurrent changes."""

    holds = Bundle("holds")

    def __init__(self) -> None:
        super().__init__()
        self.folder = Path(tempfile.mkdtemp())
        self.bench = Bench(budget=BUDGET)
        self.runner = asyncio.Runner()
        self.registry = self.bench.registry(self.folder)
        self.held = 0

    @rule(id=ids, content=st.sampled_from(FILES), description=st.sampled_from(DESCRIPTIONS))
    def put(self, id: str, content: bytes, description: bytes) -> None:
        folder = self.folder / id
        folder.mkdir(exist_ok=True)
        # Replaced atomically, as users should copy scenes: a load may be reading the old file.
        for name, new in (("scene.ply", content), ("scene.json", description)):
            plys.write(self.folder / ".new", new).replace(folder / name)

    @rule(id=ids)
    def vanish(self, id: str) -> None:
        shutil.rmtree(self.folder / id, ignore_errors=True)

    @rule()
    def scan(self) -> None:
        self.runner.run(self.registry.scan())
        folders = {path.name for path in self.folder.iterdir() if path.is_dir()}
        assert {info.id for info in self.registry.scene_infos()} == folders

    @rule(id=ids)
    def load(self, id: str) -> None:
        known = {info.id for info in self.registry.scene_infos()}
        try:
            self.runner.run(self.registry.load(id))
        except UnknownScene:
            now = {info.id for info in self.registry.scene_infos()}
            assert id not in known or id not in now
        except (BrokenScene, Overloaded) as error:
            assert_sentence(error.detail)
        else:
            assert self.registry.scene_info(id).state == "loaded"

    @rule(id=ids)
    def unload(self, id: str) -> None:
        with contextlib.suppress(UnknownScene):
            self.registry.unload(id)

    @rule(target=holds, id=ids)
    def hold(self, id: str) -> SceneUse | None:
        use = self.registry.use(id)
        try:
            scene = self.runner.run(use.__aenter__())
        except (UnknownScene, BrokenScene, Overloaded) as error:
            assert_sentence(error.detail)
            return None
        assert scene.gaussians == scene.prepared.nbytes > 0
        self.held += 1
        return use

    @rule(use=consumes(holds))
    def release(self, use: SceneUse | None) -> None:
        if use is not None:
            self.runner.run(use.__aexit__(None, None, None))
            self.held -= 1

    @rule()
    def evict(self) -> None:
        self.registry.evict()

    @rule(seconds=st.sampled_from((1, 61)))
    def wait(self, seconds: int) -> None:
        self.bench.now += seconds
        self.registry.evict_idle(self.bench.now)

    @invariant()
    def what_is_told_holds(self) -> None:
        infos = self.registry.scene_infos()
        assert [info.id for info in infos] == sorted(info.id for info in infos)
        for info in infos:
            assert (info.memory_bytes > 0) == (info.state == "loaded")
            assert (info.error is not None) == (info.state == "broken")
            if info.error is not None:
                assert_sentence(info.error)

    @invariant()
    def memory_is_within_its_budget(self) -> None:
        entries = {*self.registry._entries.values(), *self.registry._retired}
        assert sum(entry.reserved for entry in entries) <= BUDGET
        assert sum(entry.users for entry in entries) == self.held

    def teardown(self) -> None:
        with self.runner:
            self.bench.now += 1000
            self.registry.evict_idle(self.bench.now)
            if not self.held:
                assert not self.registry._retired
                assert all(entry.loaded is None and not entry.reserved for entry in self.registry._entries.values())
        shutil.rmtree(self.folder)


TestRegistry = RegistryMachine.TestCase
TestRegistry.settings = effort(25)
