"""The services that runs are made against: real ones, but for the shaper, which only pretends."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.experiments.stub import Stub, installed
from tests.prerequisites import BUILT_PAGE, CHROMIUM
from tests.web.fake_shaper import FakeShaper
from tests.web.scenes import write_scenes
from tests.web.server import TIGAS, Packager, RenderServer


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


@pytest.fixture
def stub(monkeypatch: pytest.MonkeyPatch) -> Stub:
    """An environment that only pretends, in place of services and browser."""
    return installed(monkeypatch)
