"""The services that runs are made against: real ones, but for the shaper, which only pretends."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.experiments.stub import Stub, installed
from tests.web.conftest import CHROMIUM, STATIC
from tests.web.fake_shaper import FakeShaper
from tests.web.scenes import write_scenes
from tests.web.server import Packager, RenderServer


@dataclass(frozen=True)
class Services:
    """What runs, and where."""

    url: str
    shaper: FakeShaper


@pytest.fixture(scope="module")
def services(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Services]:
    """The viewer of a render service that knows a packager and a shaper."""
    if not STATIC.exists():
        pytest.skip("the web client is not built: cd web && npm ci && npm run build")
    if CHROMIUM is None:
        pytest.skip("Chromium is not installed: sudo apt-get install chromium")
    models = tmp_path_factory.mktemp("models")
    write_scenes(models)
    packager = Packager()
    with FakeShaper() as shaper:
        known = {"TIGAS_RENDER_SERVICES": json.dumps({"dash": packager.url, "shaper": shaper.url})}
        with RenderServer("--scenes", str(models), environment=known) as render:
            packager.render = render.url.rstrip("/")
            with packager:
                yield Services(render.url, shaper)


@pytest.fixture
def out(tmp_path: Path) -> Path:
    """Where a comparison goes."""
    return tmp_path / "out"


@pytest.fixture
def stub(monkeypatch: pytest.MonkeyPatch) -> Stub:
    """An environment that only pretends, in place of services and browser."""
    return installed(monkeypatch)
