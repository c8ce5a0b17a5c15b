"""The services that runs are made against: real ones, but for the shaper, which only pretends; or none at all."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator, Callable, Iterable, Iterator, Sequence
from contextlib import asynccontextmanager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from tests.experiments.made_up import MACHINE, SERVER
from tests.prerequisites import BUILT_PAGE, CHROMIUM
from tests.scenes import scene
from tests.web.fake_shaper import FakeShaper
from tests.web.scenes import write_scenes
from tests.web.server import TIGAS, Packager, RenderServer
from tigas_common.wire.render import Rung
from tigas_experiments.errors import RunFailed
from tigas_experiments.records.folder import RunRecord, RunWriter
from tigas_experiments.records.machine import Server
from tigas_experiments.report.cli import Report
from tigas_experiments.run import measure as run_module
from tigas_experiments.run import runner
from tigas_experiments.run.checks import RunVersions
from tigas_experiments.run.inputs import Inputs
from tigas_experiments.wire.run import Configuration


@dataclass(frozen=True)
class Services:
    url: str
    shaper: FakeShaper


@pytest.fixture(scope="module")
def services(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Services]:
    """The viewer of a render service that knows a packager and a shaper."""
    with running(tmp_path_factory.mktemp("models")) as found:
        yield found


@contextmanager
def running(models: Path, program: Sequence[str] = TIGAS) -> Iterator[Services]:
    """All of them, with the tests' scenes in a directory."""
    BUILT_PAGE.require()
    CHROMIUM.require()
    write_scenes(models)
    packager = Packager(idle_s=15)  # of browsers that are killed, streams are left
    with FakeShaper() as shaper:
        known = {"TIGAS_RENDER_SERVICES": json.dumps({"dash": packager.url, "shaper": shaper.url})}
        with RenderServer("--scenes", str(models), environment=known, program=program) as render:
            packager.render = render.url.rstrip("/")
            with packager:
                yield Services(render.url, shaper)


@pytest.fixture
def out(tmp_path: Path) -> Path:
    return tmp_path / "out"


Happening = Callable[[RunWriter], None]


class Stub:
    """An environment scripted by a test, run by run; afterwards all goes well."""

    machine = MACHINE
    inputs: Inputs
    ladder = ""
    """Requests of the experiment."""
    commit = "abc"
    browser = "156"
    server = Server.from_config(SERVER)
    scene_bytes = 1000
    scene_ladder: tuple[Rung, ...] | None = None
    scene_sha256: str | None = "a" * 64

    def __init__(self) -> None:
        self.happenings: list[Happening | None] = []
        self.made: list[str] = []
        self.checked = 0
        self.reported: list[Path] = []

    async def check(self, runs: list[Configuration]) -> None:
        self.checked += 1

    async def versions(self, scenes: Iterable[str]) -> RunVersions:
        now: dict[str, Any] = {
            "file_bytes": self.scene_bytes,
            "file_sha256": self.scene_sha256,
            "ladder": self.scene_ladder,
        }
        return RunVersions(self.commit, self.browser, self.server, {name: scene(id=name, **now) for name in scenes})

    async def setup(self, configuration: Configuration) -> None:
        self.made.append(configuration.slug)

    async def measure(self, _: object, configuration: Configuration, writer: RunWriter, stage: object) -> RunRecord:
        happening = self.happenings.pop(0) if self.happenings else None
        if happening is not None:
            happening(writer)
            await asyncio.sleep(60)  # interrupted
        return writer.close(
            status="complete",
            machine=MACHINE.model_copy(update={"commit": self.commit}),
            browser=self.browser,
            server=self.server,
            scene_bytes=self.scene_bytes,
            scene_sha256=self.scene_sha256,
            inputs_sha256=self.inputs.digests(configuration),
        )


@pytest.fixture
def stub(monkeypatch: pytest.MonkeyPatch) -> Stub:
    """An environment that only pretends, in place of services and browser."""
    made = Stub()

    @asynccontextmanager
    async def open_environment(url: object, inputs: Inputs, *, ladder: str, webgpu: bool) -> AsyncIterator[Stub]:
        made.inputs, made.ladder = inputs, ladder
        yield made

    monkeypatch.setattr(runner, "open_environment", open_environment)
    monkeypatch.setattr(run_module, "_measure", made.measure)
    monkeypatch.setattr(Report, "run", lambda report: made.reported.append(report.folder))
    return made


def fails(writer: RunWriter) -> None:
    raise RunFailed("The viewer failed: Target closed")
