"""Wires the store together and serves its API until stopped."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from functools import partial
from pathlib import Path

from tigas_common.address import warn_if_open
from tigas_common.limits import HttpLimits
from tigas_common.loop_share import LoopShare
from tigas_common.offload import Offload, offload_to_process
from tigas_common.origins import OriginPolicy
from tigas_common.resources import use_one_arena
from tigas_common.runner import listen_errors, serve_listener, wait_for_stop
from tigas_experiments.records.load import SAMPLE_EVERY_S, LoadSample, monitor_load
from tigas_experiments.records.machine import Machine, describe_machine
from tigas_experiments.store.app import Store, create_app
from tigas_experiments.store.experiments import Experiments
from tigas_experiments.store.movements import Movements
from tigas_experiments.store.planner import Planner, Services, prepare_render_service
from tigas_experiments.store.reports import Reports
from tigas_experiments.store.rerendering import RerenderingJobs
from tigas_experiments.store.settings import StoreSettings
from tigas_experiments.store.workspace import Workspace

REMEMBERED_S = 3 * 3600
"""Period for which the machine's load is remembered: longer than the longest run and its upload."""


async def serve(settings: StoreSettings) -> None:
    """Run the store until SIGINT or SIGTERM. Raises StartError."""
    use_one_arena()
    limits = HttpLimits.from_settings(settings.http_limits)
    async with AsyncExitStack() as stack:
        with listen_errors(settings.http, "--http"):  # before anything slow
            listener = stack.enter_context(settings.http.listen(limits.unread_s))
        load = await stack.enter_async_context(monitor_load(settings.render, keep=int(REMEMBERED_S / SAMPLE_EVERY_S)))
        machine = await asyncio.to_thread(describe_machine)
        opened = open_store(settings.results, settings.movements, settings.render, machine=machine, load=load)
        store = await stack.enter_async_context(opened)
        policy = OriginPolicy.from_addresses([settings.http], settings.allow_hosts, settings.allow_origins)
        app = LoopShare(create_app(store, policy), limits.loop_share_per_address, policy)
        port = await stack.enter_async_context(serve_listener(app, listener, limits))
        warn_if_open([settings.http])
        print(f"Experiments in {settings.results} on http://{settings.http.reachable_host}:{port}/", flush=True)
        await wait_for_stop()


@asynccontextmanager
async def open_store(
    results: Path,
    movements: Path,
    render: str,
    *,
    machine: Machine,
    load: Sequence[LoadSample],
    offload: Offload = offload_to_process,
    services: Services | None = None,
    clock: Callable[[], float] = time.monotonic,
) -> AsyncIterator[Store]:
    """The store's components, as a context manager; `services` are those at `render` by default. Raises StartError."""
    with Workspace.open(results) as workspace:
        experiments = Experiments(results, workspace)
        async with RerenderingJobs.connect(experiments, render) as rerendering:
            planner = Planner(
                experiments,
                workspace,
                offload,
                movements=movements,
                render=render,
                services=services or partial(prepare_render_service, render.rstrip("/")),
                machine=machine,
                load=load,
                clock=clock,
            )
            reports = Reports(experiments, workspace, offload)
            yield Store(workspace, experiments, reports, Movements(movements), planner, rerendering)
