"""The environment of many runs: services, one browser, and inputs.

These take much longer to start than a run's new browser context. Dead resources are restarted for the next run.
"""

from __future__ import annotations

from collections.abc import AsyncIterator, Awaitable, Callable, Iterable, Mapping, Sequence
from contextlib import AbstractAsyncContextManager, AsyncExitStack, asynccontextmanager
from dataclasses import dataclass
from typing import Generic, TypeVar

from playwright.async_api import Browser

from tigas_common.errors import StartError
from tigas_common.wire.render import LadderName
from tigas_experiments.errors import RunFailed
from tigas_experiments.lock import hold_lock, services_lock
from tigas_experiments.records.machine import Machine, Server, describe_machine
from tigas_experiments.run.browser import find_chromium, is_responsive, launch_chromium, open_viewer
from tigas_experiments.run.checks import RunVersions, check_services
from tigas_experiments.run.inputs import Inputs, points_sha256
from tigas_experiments.run.job import RunSources
from tigas_experiments.run.link import reserve_link
from tigas_experiments.run.targets import LAB_URL, Target, find_fault, lab_target, load_scene, url_target
from tigas_experiments.wire.movement import TimedPose
from tigas_experiments.wire.run import PER_VIEW, Configuration, Network

Resource = TypeVar("Resource")


@dataclass(frozen=True, slots=True)
class RunSetup:
    target: Target
    browser: Browser
    points: Sequence[TimedPose]
    network: Network
    """The network, with an absolute path to its trace file."""
    made_from: RunSources


class ReopenedResource(Generic[Resource]):
    """A resource that is opened on first use and reopened once it has died."""

    def __init__(
        self,
        opened: Callable[[], AbstractAsyncContextManager[Resource]],
        lives: Callable[[Resource], Awaitable[bool]],
    ) -> None:
        self._opened = opened
        self._lives = lives
        self._stack = AsyncExitStack()
        self._resource: Resource | None = None

    async def get(self) -> Resource:
        """A live resource. Raises the errors of opening it."""
        if self._resource is not None and not await self._lives(self._resource):
            await self.close()
        if self._resource is None:
            self._resource = await self._stack.enter_async_context(self._opened())
        return self._resource

    async def close(self) -> None:
        """Close the resource until the next `get`."""
        self._resource = None
        await self._stack.aclose()


class Environment:
    """Services and a browser for many runs, one run at a time."""

    def __init__(
        self,
        target: ReopenedResource[Target],
        browser: ReopenedResource[Browser],
        machine: Machine,
        inputs: Inputs,
        ladder: LadderName = "scene",
    ) -> None:
        self._ladder = ladder
        self._target = target
        self._browser = browser
        self._opened_for: Target | None = None
        self._inputs = inputs
        self._points: dict[tuple[object, ...], Sequence[TimedPose]] = {}
        self.machine = machine

    async def check(self, runs: Sequence[Configuration]) -> None:
        """Check before the first run that all runs can be made. Raises StartError with one sentence.

        Checks services, browser, scenes, movements, networks, packager, rungs, controllers and models.
        """
        target, _ = await self._services()
        scenes = {}
        for configuration in {_pose_inputs(run): run for run in runs}.values():
            scenes[configuration.scene] = (await self.setup(configuration)).made_from.scene
        check_services(runs, target, scenes, self._ladder)
        for network in {run.network: None for run in runs}:
            try:
                async with reserve_link(target, self._inputs.network(network)):
                    pass
            except RunFailed as error:
                raise StartError(str(error)) from None
        controllers = {run.profile for run in runs if run.mode in PER_VIEW and isinstance(run.profile, str)}
        asked = {f"The controller {name!r}": {"controller": name} for name in sorted(controllers)}
        for restore, upscale in sorted({(run.restore, run.upscale) for run in runs if run.enhanced}):
            asked[f"restore = {restore!r}, upscale = {upscale!r}"] = {"restore": restore, "upscale": upscale}
        if asked:
            await self._check_on_page(runs[0], asked)

    async def versions(self, scenes: Iterable[str]) -> RunVersions:
        """Versions and inputs of new runs in these scenes. Raises StartError."""
        target, browser = await self._services()
        found = {scene: await load_scene(target.url, scene) for scene in scenes}
        return RunVersions(self.machine.commit, browser.version, Server.from_config(target.config), found)

    async def setup(self, configuration: Configuration) -> RunSetup:
        """Resources of a run, with its scene loaded and its download prepared. Raises StartError."""
        target, browser = await self._services()
        download = configuration.mode == "local-compressed"
        scene = await load_scene(target.url, configuration.scene, download=download)
        digests = self._inputs.digests(configuration)
        key = (*_pose_inputs(configuration), digests.movement)
        if key not in self._points:
            self._points[key] = self._inputs.points(configuration, scene)
        network = self._inputs.network(configuration.network)
        points = self._points[key]
        made_from = RunSources(digests, points_sha256(points), target.config, scene)
        return RunSetup(target, browser, points, network, made_from)

    async def _services(self) -> tuple[Target, Browser]:
        """Live services, and a browser that was started for them and trusts their certificate."""
        target = await self._target.get()
        if target is not self._opened_for:
            await self._browser.close()
            self._opened_for = target
        return target, await self._browser.get()

    async def _check_on_page(self, run: Configuration, asked: Mapping[str, dict[str, str]]) -> None:
        """Check these settings, keyed by display name, on the page, as only the page knows its controllers and models.
        Raises StartError.
        """
        setup = await self.setup(run)
        try:
            async with open_viewer(
                setup.browser, setup.target.url, setup.made_from.scene.id, run.width, run.height
            ) as page:
                for what, settings in asked.items():
                    try:
                        # Off by default: without graphics acceleration, the page reports that it does not reproject.
                        await page.prepare({"reprojection": False, **settings}, setup.points[0])
                    except RunFailed as error:
                        raise StartError(f"{what} cannot be measured: {error}") from None
        except RunFailed as error:
            raise StartError(str(error)) from None


@asynccontextmanager
async def open_environment(
    url: str | None,
    inputs: Inputs,
    *,
    ladder: LadderName = "scene",
    webgpu: bool = False,
) -> AsyncIterator[Environment]:
    """Exclusive use of the services at `url` or, by default, of a lab that is started on first use.

    The lab's render service and shaper take their directories from their own settings. `ladder` is the ladder to which
    profiles refer. `webgpu` lets pages enhance frames. Raises StartError.
    """
    find_chromium()
    where = url or LAB_URL

    with hold_lock(services_lock(where), f"Another experiment uses the services at {where}; wait until it ends."):
        target = ReopenedResource(lambda: lab_target(ladder) if url is None else url_target(url), _is_working)
        browser = ReopenedResource(lambda: _launch_browser(target, webgpu=webgpu), is_responsive)
        try:
            yield Environment(target, browser, describe_machine(), inputs, ladder)
        finally:
            try:
                await browser.close()
            finally:
                await target.close()


async def _is_working(target: Target) -> bool:
    return await find_fault(target) is None


@asynccontextmanager
async def _launch_browser(target: ReopenedResource[Target], *, webgpu: bool) -> AsyncIterator[Browser]:
    config = (await target.get()).config
    async with launch_chromium(config, webgpu=webgpu) as browser:
        yield browser


def _pose_inputs(configuration: Configuration) -> tuple[object, ...]:
    """The parameters that determine the poses."""
    return (
        configuration.scene,
        configuration.movement,
        configuration.movement_offset_s,
        configuration.seed,
        configuration.duration_s,
    )
