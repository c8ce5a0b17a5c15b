"""The environment of many runs: the services, one browser, and the inputs.

Starting these takes far longer than what is new in each run, a context of the browser. What has died is started again
for the next run.
"""

from __future__ import annotations

from collections.abc import AsyncIterator, Awaitable, Callable, Iterable, Mapping, Sequence
from contextlib import AbstractAsyncContextManager, AsyncExitStack, asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, TypeVar

from playwright.async_api import Browser

from tigas_common.errors import StartError
from tigas_common.wire.render import LadderName, SceneInfo
from tigas_common.wire.run import OFF, PER_VIEW, Configuration, Network
from tigas_experiments.errors import RunFailed
from tigas_experiments.lock import exclusive, services_lock
from tigas_experiments.movement.trace import Point
from tigas_experiments.records.folder import InputDigests
from tigas_experiments.records.machine import Machine, Server, this_machine
from tigas_experiments.run.browser import chromium, find_chromium, responds, viewer
from tigas_experiments.run.changes import MadeWith
from tigas_experiments.run.inputs import Inputs
from tigas_experiments.run.link import held
from tigas_experiments.run.targets import LAB_URL, Target, alive, lab_target, load_scene, make_download, url_target

Resource = TypeVar("Resource")


@dataclass(frozen=True, slots=True)
class Setup:
    """What one run is made with."""

    target: Target
    browser: Browser
    scene: SceneInfo
    points: Sequence[Point]
    network: Network
    """With a path to its trace's file that can be opened."""
    digests: InputDigests


class Supervised(Generic[Resource]):
    """A resource that is opened when it is first asked for, and opened again when it has died."""

    def __init__(
        self,
        opened: Callable[[], AbstractAsyncContextManager[Resource]],
        lives: Callable[[Resource], Awaitable[bool]],
    ) -> None:
        self._opened = opened
        self._lives = lives
        self._stack = AsyncExitStack()
        self._now: Resource | None = None

    async def get(self) -> Resource:
        """One that lives. Raises what opening raises."""
        if self._now is not None and not await self._lives(self._now):
            await self.close()
        if self._now is None:
            self._now = await self._stack.enter_async_context(self._opened())
        return self._now

    async def close(self) -> None:
        """Until it is asked for again."""
        self._now = None
        await self._stack.aclose()


class Environment:
    """Services and a browser for many runs, one at a time."""

    def __init__(
        self,
        target: Supervised[Target],
        browser: Supervised[Browser],
        machine: Machine,
        inputs: Inputs,
        ladder: LadderName = "scene",
    ) -> None:
        self._ladder = ladder
        self._target = target
        self._browser = browser
        self._inputs = inputs
        self._points: dict[tuple[object, ...], Sequence[Point]] = {}
        self.machine = machine

    async def check(self, runs: Sequence[Configuration]) -> None:
        """Find out before the first run whether all that the runs need can be had. Raises StartError with one sentence.

        Services and browser, scenes, movements and networks, packager, rungs, controllers and models.
        """
        await self._browser.get()
        target = await self._target.get()
        _check_packager(runs, target)
        scenes = {}
        for configuration in {_inputs(run): run for run in runs}.values():
            scenes[configuration.scene] = (await self.setup(configuration)).scene
        _check_rungs(runs, target, scenes, self._ladder)
        _check_downloads(runs, scenes)
        for network in {run.network: None for run in runs}:
            try:
                async with held(target, self._inputs.network(network)):
                    pass
            except RunFailed as error:
                raise StartError(str(error)) from None
        controllers = {run.profile for run in runs if run.mode in PER_VIEW and isinstance(run.profile, str)}
        asked = {f"The controller {name!r}": {"controller": name} for name in sorted(controllers)}
        for restore, upscale in sorted({(run.restore, run.upscale) for run in runs if run.enhanced}):
            asked[f"restore = {restore!r}, upscale = {upscale!r}"] = {"restore": restore, "upscale": upscale}
        for prediction in sorted({run.prediction for run in runs} - {OFF}):
            asked[f"The predictor {prediction!r}"] = {"prediction": prediction}
        if asked:
            await self._ask_the_page(runs[0], asked)

    async def made_with(self, scenes: Iterable[str]) -> MadeWith:
        """What runs in these scenes would be made with now. Raises StartError."""
        target, browser = await self._target.get(), await self._browser.get()
        found = {scene: await load_scene(target.url, scene) for scene in scenes}
        return MadeWith(self.machine.commit, browser.version, Server.of(target.config), found)

    async def setup(self, configuration: Configuration) -> Setup:
        """What a run needs; the scene is loaded, and its download is made. Raises StartError."""
        target = await self._target.get()
        scene = await load_scene(target.url, configuration.scene)
        if configuration.download is not None and any(one.form == configuration.download for one in scene.downloads):
            await make_download(target.url, scene.id, configuration.download)
        digests = self._inputs.digests(configuration)
        key = (*_inputs(configuration), digests.movement)
        if key not in self._points:
            self._points[key] = self._inputs.points(configuration, scene)
        network = self._inputs.network(configuration.network)
        return Setup(target, await self._browser.get(), scene, self._points[key], network, digests)

    async def _ask_the_page(self, run: Configuration, asked: Mapping[str, dict[str, str]]) -> None:
        """Whether it has what these settings, by their names for people, ask for: it alone knows. Raises StartError."""
        setup = await self.setup(run)
        try:
            async with viewer(setup.browser, setup.target.url, setup.scene.id, run.width, run.height) as page:
                for what, settings in asked.items():
                    try:
                        await page.prepare(settings, setup.points[0])
                    except RunFailed as error:
                        raise StartError(f"{what} cannot be measured: {error}") from None
        except RunFailed as error:
            raise StartError(str(error)) from None


@asynccontextmanager
async def open_environment(
    url: str | None,
    scenes: Path | None,
    traces: Path | None,
    inputs: Inputs,
    *,
    ladder: LadderName = "scene",
    webgpu: bool = False,
) -> AsyncIterator[Environment]:
    """For as long as the context lasts, and for nobody else meanwhile. Raises StartError.

    The services at `url`, or the lab's, which is started when it is first needed; `scenes` and `traces` are its
    directories, and `ladder` what profiles count in. With `webgpu`, pages can enhance frames.
    """
    find_chromium()
    where = url or LAB_URL

    with exclusive(services_lock(where), f"Another experiment uses the services at {where}; wait until it has ended."):
        target = Supervised(lambda: lab_target(scenes, traces, ladder) if url is None else url_target(url), alive)
        browser = Supervised(lambda: chromium(webgpu=webgpu), responds)
        try:
            yield Environment(target, browser, this_machine(), inputs, ladder)
        finally:
            try:
                await browser.close()
            finally:
                await target.close()


def _check_packager(runs: Sequence[Configuration], target: Target) -> None:
    """Whether there is one, if the runs need it. Raises StartError."""
    for run in runs:
        if run.streamed and target.dash is None:
            raise StartError(f"There is no packager behind {target.url}, so {run.mode} cannot be measured.")


def _check_downloads(runs: Sequence[Configuration], scenes: Mapping[str, SceneInfo]) -> None:
    """Whether scenes are offered in the forms that the runs download. Raises StartError."""
    for run in runs:
        if run.download is not None and run.download not in {one.form for one in scenes[run.scene].downloads}:
            raise StartError(f"{run.scene} is not offered for download, so {run.mode} cannot be measured.")


def _check_rungs(
    runs: Sequence[Configuration], target: Target, scenes: Mapping[str, SceneInfo], ladder: LadderName
) -> None:
    """Whether the scenes have the ladder that was asked for, and the rungs that the runs name. Raises StartError."""
    for run in runs:
        own = scenes[run.scene].ladder
        if ladder == "paper" and own is not None:
            raise StartError(
                f"The services at {target.url} show {run.scene} with a ladder of its own, and the experiment asks for "
                "the paper's: start the render service with --ladder paper."
            )
        rungs = len(own or target.config.ladder)
        if run.mode not in PER_VIEW:
            rung = None if run.dash_representation is None else run.dash_representation.rung
        else:
            rung = run.profile if isinstance(run.profile, int) else None
        if rung is not None and rung >= rungs:
            raise StartError(f"There is no rung {rung}: the ladder at {target.url} has {rungs}, counted from 0.")


def _inputs(configuration: Configuration) -> tuple[object, ...]:
    """What decides the poses."""
    return (
        configuration.scene,
        configuration.movement,
        configuration.movement_offset_s,
        configuration.seed,
        configuration.duration_s,
    )
