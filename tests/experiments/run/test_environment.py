"""The environment of runs: kept while it works, restarted when it has died, and used by one experiment at a time."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, nullcontext
from dataclasses import replace
from pathlib import Path
from stat import S_IMODE
from typing import Any

import pytest

from tests.experiments.made_up import MACHINE, SERVER, configuration
from tests.scenes import scene
from tests.web.fake_shaper import FakeShaper
from tigas_common.errors import StartError
from tigas_common.wire.render import LadderName, Rung
from tigas_experiments.errors import RunFailed
from tigas_experiments.lock import hold_lock, services_lock
from tigas_experiments.run import environment as module
from tigas_experiments.run.environment import Environment, ReopenedResource, open_environment
from tigas_experiments.run.inputs import Inputs
from tigas_experiments.run.targets import Target
from tigas_experiments.wire.run import Configuration, Network


class Counted:
    """Something that is opened and closed, and may die."""

    def __init__(self) -> None:
        self.opened = 0
        self.closed = 0
        self.alive = True

    @asynccontextmanager
    async def open(self) -> AsyncIterator[int]:
        self.opened += 1
        yield self.opened
        self.closed += 1

    async def lives(self, _: int) -> bool:
        return self.alive


def test_a_resource_is_opened_once_and_again_when_it_has_died() -> None:
    async def use() -> None:
        counted = Counted()
        kept = ReopenedResource(counted.open, counted.lives)
        assert [await kept.get(), await kept.get()] == [1, 1]
        counted.alive = False
        assert await kept.get() == 2
        assert counted.closed == 1, "the dead one was tidied up"
        await kept.close()
        await kept.close()
        assert (counted.opened, counted.closed) == (2, 2)

    asyncio.run(use())


def test_one_holder_at_a_time(tmp_path: Path) -> None:
    lock = tmp_path / "lock"
    with hold_lock(lock, "no"), pytest.raises(StartError, match=r"^not you$"), hold_lock(lock, "not you"):
        pass
    with hold_lock(lock, "no"):
        pass
    assert S_IMODE(lock.stat().st_mode) == 0o666, "what root has left behind keeps nobody out"


@pytest.mark.parametrize("url", ["http://localhost:99999", "http://[::1"])
def test_what_is_no_url_is_told_in_a_sentence(url: str) -> None:
    with pytest.raises(StartError, match=r"is not a URL: .+\.$"):
        services_lock(url)


def test_services_are_the_same_whatever_they_are_called() -> None:
    assert services_lock("http://localhost:8080") == services_lock("http://127.0.0.1:8080/")
    assert services_lock("http://localhost:8080") != services_lock("http://localhost:8081")
    assert "/" not in services_lock("http://a..%2fb/../c").name


def test_another_experiment_s_services_are_left_alone() -> None:
    async def open_it() -> None:
        async with open_environment("http://127.0.0.1:9", Inputs(Path())):
            pass

    with (
        hold_lock(services_lock("http://127.0.0.1:9"), ""),
        pytest.raises(StartError, match=r"^Another experiment uses the services"),
    ):
        asyncio.run(open_it())


REFUSED = "The viewer failed: controller has an invalid value"


def supervised(resource: Any) -> ReopenedResource[Any]:
    async def lives(_: object) -> bool:
        return True

    return ReopenedResource(lambda: nullcontext(resource), lives)


class World:
    """Services without a shaper, with a page that knows two controllers and a model."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, **services: str) -> None:
        self.target = Target("http://127.0.0.1:9", SERVER.model_copy(update={"services": services}))
        self.asked: list[str] = []
        self.pages = 0
        self.made: list[str] = []
        self.ladder: tuple[Rung, ...] | None = None
        """The scene's own."""
        monkeypatch.setattr(module, "open_viewer", self.viewer)
        monkeypatch.setattr(module, "load_scene", self.load_scene)

    @asynccontextmanager
    async def viewer(self, *_: object) -> AsyncIterator[World]:
        self.pages += 1
        yield self

    async def load_scene(self, _: str, name: str, *, download: bool = False) -> object:
        self.made += [name] * download
        return scene(ladder=self.ladder, downloads=())

    async def prepare(self, settings: dict[str, Any], pose: object) -> None:
        if settings.get("reprojection", True):
            raise RunFailed("Frames are not shown as they should be: No graphics acceleration here.")
        asked = [value for name, value in settings.items() if name != "reprojection"]
        self.asked += asked
        if not {"seen", "latency", "off", "bicubic"}.issuperset(asked):
            raise RunFailed(REFUSED)

    def environment(self, directory: Path = Path(), ladder: LadderName = "scene") -> Environment:
        return Environment(supervised(self.target), supervised(None), MACHINE, Inputs(directory), ladder)

    def check(self, *runs: Configuration, ladder: LadderName = "scene") -> None:
        asyncio.run(self.environment(ladder=ladder).check(runs))


def unshaped(**changes: Any) -> Configuration:
    return configuration(**changes, network=Network())


def test_each_controller_is_asked_for_once_before_the_first_run(monkeypatch: pytest.MonkeyPatch) -> None:
    world = World(monkeypatch, dash="http://127.0.0.1:9")
    wanted = [unshaped(profile=profile, repeat=repeat) for profile in ("seen", "latency", 3) for repeat in (0, 1)]
    world.check(*wanted, unshaped(mode="dash-tuned", profile="unused"))
    assert (world.asked, world.pages) == (["latency", "seen"], 1)


def test_models_are_asked_for_once_before_the_first_run(monkeypatch: pytest.MonkeyPatch) -> None:
    world = World(monkeypatch)
    world.check(*[unshaped(profile=0, upscale="bicubic", repeat=repeat) for repeat in (0, 1)], unshaped(profile=1))
    assert (world.asked, world.pages) == (["off", "bicubic"], 1)


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"upscale": "magic"}, f"restore = 'off', upscale = 'magic' cannot be measured: {REFUSED}"),
        ({"profile": "magic"}, f"The controller 'magic' cannot be measured: {REFUSED}"),
        ({"profile": 4}, "There is no rung 4: the ladder at http://127.0.0.1:9 has 4 rungs, counted from 0."),
        ({"mode": "dash-tuned"}, "There is no packager behind http://127.0.0.1:9, so dash-tuned cannot be measured."),
        (
            {"mode": "local-compressed"},
            "courtyard is not offered for download, so local-compressed cannot be measured.",
        ),
    ],
)
def test_what_the_services_do_not_have_is_said_before_the_first_run(
    monkeypatch: pytest.MonkeyPatch, changes: dict[str, Any], sentence: str
) -> None:
    with pytest.raises(StartError) as error:
        World(monkeypatch).check(unshaped(), unshaped(**changes))
    assert str(error.value) == sentence


def test_a_network_that_the_shaper_refuses_is_told_before_the_first_run(monkeypatch: pytest.MonkeyPatch) -> None:
    refused = pytest.raises(StartError, match=r"^The shaper refused /start: There is no such trace\.$")
    with FakeShaper() as shaper, refused:
        World(monkeypatch, shaper=shaper.url).check(configuration(network=Network(trace="no-such-trace")))


def test_dash_over_http3_needs_services_that_offer_it(monkeypatch: pytest.MonkeyPatch) -> None:
    world = World(monkeypatch, dash="http://127.0.0.1:9")
    over_h3 = unshaped(mode="dash-edge", dash_transport="h3")
    with pytest.raises(StartError, match=r"offers no DASH over HTTP/3, so dash-edge cannot be measured over it\.$"):
        world.check(over_h3)
    world.target = replace(world.target, config=world.target.config.model_copy(update={"dash_h3_url": "https://a"}))
    world.check(over_h3)


def test_services_that_were_started_again_get_a_browser_that_trusts_them(monkeypatch: pytest.MonkeyPatch) -> None:
    world, browser = World(monkeypatch), Counted()

    async def lives(target: Target) -> bool:
        return target is world.target

    async def use() -> None:
        target = ReopenedResource(lambda: nullcontext(world.target), lives)
        lab = Environment(target, ReopenedResource(browser.open, browser.lives), MACHINE, Inputs(Path()))  # type: ignore[arg-type]
        for _ in range(2):
            assert (await lab.setup(unshaped())).browser == 1  # type: ignore[comparison-overlap]
        world.target = replace(world.target)
        assert (await lab.setup(unshaped())).browser == 2  # type: ignore[comparison-overlap]

    asyncio.run(use())


def test_what_a_run_downloads_is_made_before_it(monkeypatch: pytest.MonkeyPatch) -> None:
    world = World(monkeypatch)
    lab = world.environment()
    asyncio.run(lab.setup(unshaped()))
    assert world.made == []
    asyncio.run(lab.setup(unshaped(mode="local-compressed")))
    assert world.made == ["courtyard"]


def test_a_representation_has_a_rung_of_the_ladder(monkeypatch: pytest.MonkeyPatch) -> None:
    world = World(monkeypatch, dash="http://127.0.0.1:9")
    world.check(unshaped(mode="dash-tuned", dash_representation={"rung": 3, "bitrate_kbps": 500}))
    with pytest.raises(StartError, match="There is no rung 4"):
        world.check(unshaped(mode="dash-tuned", dash_representation={"rung": 4, "bitrate_kbps": 500}))


def test_rungs_are_those_of_the_scenes_own_ladder_unless_the_papers_is_asked_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    world = World(monkeypatch)
    world.check(unshaped(profile=3), ladder="paper")
    world.ladder = SERVER.ladder[:1] * 6
    world.check(unshaped(profile=5))
    with pytest.raises(StartError, match=r"There is no rung 6: .* has 6"):
        world.check(unshaped(profile=6))
    with pytest.raises(StartError, match=r"with its own ladder, .* start the render service with --ladder paper\.$"):
        world.check(unshaped(profile=3), ladder="paper")


def test_a_page_that_cannot_be_opened_is_said_before_the_first_run(monkeypatch: pytest.MonkeyPatch) -> None:
    world = World(monkeypatch)

    @asynccontextmanager
    async def viewer(*_: object) -> AsyncIterator[World]:
        raise RunFailed("The viewer could not be opened.")
        yield world

    monkeypatch.setattr(module, "open_viewer", viewer)
    with pytest.raises(StartError, match=r"^The viewer could not be opened\.$"):
        world.check(unshaped())


def test_a_movement_that_was_edited_meanwhile_is_read_again(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    path, lab = tmp_path / "walk.csv", World(monkeypatch).environment(tmp_path)
    rows = "t_ms,x,y,z,qx,qy,qz,qw\n0,{x},0,0,0,0,0,1\n2000,{x},0,0,0,0,0,1\n"
    wanted = unshaped(movement="walk.csv")

    async def use() -> None:
        path.write_text(rows.format(x=1))
        first = await lab.setup(wanted)
        path.write_text(rows.format(x=22))
        second = await lab.setup(wanted)
        assert [bench.points[0]["position"][0] for bench in (first, second)] == [1, 22]
        assert first.made_from.digests != second.made_from.digests

    asyncio.run(use())
