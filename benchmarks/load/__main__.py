"""The number of viewers that a render service can serve, and its behaviour under overload.

    python -m benchmarks.load [--render "--device cuda --scenes models"] [--scene flowers] [--profile 2] [--fps 30]
    python -m benchmarks.load --url http://127.0.0.1:8080           a running service
    python -m benchmarks.load --instant 23000                       synthetic frames of this many bytes
    python -m benchmarks.load --viewers 1 4 --render ... --baseline "--edges 1"

Viewers in several processes walk through a scene, each at its own pace, and cancel frames overtaken by newer ones.
Finds the largest number of viewers with a 95th percentile within the limit and all frames served, and continues with
1.5 and 2 times as many; with --viewers, measures these numbers; with --baseline, alternates with a second service with
other options. Writes load.json and load.svg into --out. docs/deploy.md explains how to read them.
"""

from __future__ import annotations

import argparse
import os
import shlex
import signal
import sys
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import Progress, TextColumn, TimeElapsedColumn

from benchmarks.load.crowd import Crowds
from benchmarks.load.measure import Capacity, Subject, Timing, compare, measure_capacity
from benchmarks.load.plan import Plan
from benchmarks.load.report import comparison_lines, draw, line, table, verdict, write_json
from benchmarks.load.server import Server, started
from benchmarks.load.step import Step
from tigas_common.errors import StartError
from tigas_experiments.movement.table import MovementError
from tigas_experiments.records.machine import describe_machine

MOVEMENTS = sorted((Path(__file__).parents[2] / "traces/movement").glob("*.csv"))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    service = parser.add_argument_group("the service")
    service.add_argument("--url", help="of a running service, such as http://127.0.0.1:8080")
    service.add_argument("--render", default="", metavar="OPTIONS", help="of the `tigas render` that is started")
    service.add_argument("--instant", type=int, metavar="BYTES", help="start it with made-up frames of this size")
    service.add_argument("--baseline", metavar="OPTIONS", help="more options, of a second service to compare with")
    viewers = parser.add_argument_group("the viewers")
    viewers.add_argument("--scene", help="id of the scene; the first, if left out")
    viewers.add_argument("--profile", type=int, default=2, help="the rung that they ask for (default: 2)")
    viewers.add_argument("--depth", action="store_true", help="ask for depth, too, as the page does by default")
    viewers.add_argument("--fps", type=float, default=30, help="frames/s of each (default: 30)")
    viewers.add_argument("--transport", choices=["webtransport", "post", "mixed"], default="webtransport")
    viewers.add_argument("--movement", type=Path, nargs="+", default=MOVEMENTS, help="instead of the repository's own")
    viewers.add_argument("--processes", type=int, default=max(1, (os.cpu_count() or 1) // 2), help="of viewers")
    steps = parser.add_argument_group("the steps")
    steps.add_argument("--viewers", type=int, nargs="+", help="measure so many, and look for nothing")
    steps.add_argument("--first", type=int, default=4, help="how many the search begins with (default: 4)")
    steps.add_argument("--most", type=int, default=400, help="how many it tries at most (default: 400)")
    steps.add_argument("--steps", type=int, default=14, help="of the search, at most (default: 14)")
    steps.add_argument("--pairs", type=int, default=8, help="of steps beside a baseline (default: 8)")
    steps.add_argument("--seconds", type=float, default=5, help="that each step measures (default: 5)")
    steps.add_argument("--warm-up", type=float, default=1.5, help="seconds before it (default: 1.5)")
    steps.add_argument("--limit-ms", type=float, default=100, help="that the 95th percentile may have (default: 100)")
    parser.add_argument("--out", type=Path, default=Path("results/load"), help="a folder (default: results/load)")
    arguments = parser.parse_args()
    if arguments.url and (arguments.render or arguments.instant is not None or arguments.baseline is not None):
        parser.error("--url is a service that runs already: it takes no options of one that is started.")
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # so that child processes end as well
    try:
        return run(arguments)
    except (StartError, MovementError, RuntimeError) as error:
        print(error, file=sys.stderr)
        return 1


def run(arguments: argparse.Namespace) -> int:
    """Measure, and report: 0 if everything was found that was looked for."""
    console = Console(width=None if sys.stdout.isatty() else 200)
    timing = Timing(arguments.seconds, arguments.warm_up)
    title = f"{arguments.transport}, profile {arguments.profile}, {arguments.fps:g} frames/s a viewer"
    steps: list[Step] = []
    lines: list[str] = []
    figures: dict[str, Any] = {}
    complete = True

    def told(step: Step) -> None:
        steps.append(step)
        console.print(line(step), highlight=False)

    arguments.out.mkdir(parents=True, exist_ok=True)
    with ExitStack() as stack:
        columns = (TextColumn("{task.description}"), TimeElapsedColumn())
        progress = stack.enter_context(Progress(*columns, console=Console(stderr=True), transient=True))
        task = progress.add_task("starting")

        def wait(reason: str, until: float) -> None:
            progress.update(task, description=reason)
            time.sleep(max(0.0, until - time.monotonic()))

        one, other = subjects(arguments, stack)
        try:
            if other is not None:
                for viewers in arguments.viewers or (1, 4):
                    lines += comparison_lines(compare(one, other, viewers, arguments.pairs, timing, told, wait))
                figures["ratios"] = lines
            elif arguments.viewers:
                for viewers in arguments.viewers:
                    told(one.step(viewers, timing, wait))
            else:
                capacity = Capacity(arguments.limit_ms)
                try:
                    measure_capacity(
                        one, capacity, arguments.first, arguments.most, arguments.steps, timing, told, wait
                    )
                finally:
                    lines, complete = verdict(capacity), capacity.found
                    figures["capacity"] = {name: getattr(capacity, name) for name in ("viewers", "found", "limit_ms")}
                    draw(capacity, arguments.fps, title, arguments.out / "load.svg")
        finally:  # results before an interruption count
            progress.stop()
            machine = describe_machine()
            console.print(table(steps, title))
            console.print(
                *lines,
                f"Commit {machine.commit or 'unknown'}, {machine.processor}, {machine.processors} processors, "
                f"device {one.device}, {arguments.processes} processes of viewers.",
                sep="\n",
                highlight=False,
            )
            figures["arguments"] = {name: str(value) for name, value in vars(arguments).items()}
            figures |= {"title": title, "machine": machine.model_dump(), "device": one.device}
            write_json(arguments.out / "load.json", steps, figures)
    return 0 if complete else 1


def subjects(arguments: argparse.Namespace, stack: ExitStack) -> tuple[Subject, Subject | None]:
    """The service that is measured, and the baseline, each with its viewers."""

    def subject(server: Server) -> Subject:
        plan = Plan.of(
            server.address(), server.scene(arguments.scene), arguments.movement, transport=arguments.transport,
            frames_per_s=arguments.fps, profile=arguments.profile, depth=arguments.depth,
        )  # fmt: skip
        device = server.config().device or "unknown"
        return Subject(server, device, stack.enter_context(Crowds(plan, arguments.processes)))

    if arguments.url:
        return subject(Server("The service", arguments.url.rstrip("/"))), None
    options = shlex.split(arguments.render)
    if arguments.instant is not None:
        options += ["--device", f"instant:{arguments.instant}"]
    one = subject(stack.enter_context(started("The service", options)))
    if arguments.baseline is None:
        return one, None
    return one, subject(stack.enter_context(started("The baseline", [*options, *shlex.split(arguments.baseline)])))


if __name__ == "__main__":
    sys.exit(main())
