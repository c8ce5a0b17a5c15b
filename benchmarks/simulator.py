"""The simulator of docs/abr.md against the namespace lab: the same controllers, movement and traces, in both.

    sudo .venv/bin/python -m benchmarks.simulator [NETWORK ...] [--controllers NAME ...] [--out DIR] [--most N]

NETWORK is a trace's file in any format, or FILE,20ms-rtt, which replaces its delay. The lab's runs come first, each
into a folder of its own; one that is complete is kept, so that what was interrupted goes on, and `--most` makes so many
in one go. Four of them have a link that takes next to nothing and a fixed rung: what a frame takes there beyond the
server's own time is the page's. Then the simulator plays the same part of each trace, with the server's time and the
page's animation frames of that very run and the sizes of its views, and a table and a plot say how the two differ.
"""

from __future__ import annotations

import argparse
import asyncio
import sys
from pathlib import Path

from benchmarks.simulator_report import ROOT, report
from benchmarks.simulator_runs import SCENE, Plan, measure
from tigas_common.errors import StartError, TigasError
from tigas_common.wire.render import DEFAULT_LADDER
from tigas_common.wire.run import Configuration, Network
from tigas_experiments.records.recording import BrokenRecording
from tigas_experiments.run.parsing import parse_network
from tigas_shaper.traces.csv_format import format_csv
from tigas_shaper.traces.formats import load_trace

NETWORKS = [str(ROOT / "traces/network" / name) for name in ("4g-bus.csv", "dsl.csv,20ms-rtt", "step-down.csv")]
WIDTH, HEIGHT = 640, 360
FAST = "t_ms,down_kbps,up_kbps\n0,200000,200000\n1000,,\n"
"""A link that takes next to nothing."""
FAST_SECONDS = 10


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("networks", nargs="*", default=NETWORKS, metavar="NETWORK")
    parser.add_argument(
        "--controllers", nargs="+", default=["latency", "latency-transfer", "budget", "2"], metavar="NAME|RUNG"
    )
    parser.add_argument("--seconds", type=float, default=20)
    parser.add_argument("--out", type=Path, default=Path("results/simulator"))
    parser.add_argument(
        "--most", type=int, default=1000, help="make at most so many of the lab's runs, and go on later"
    )
    arguments = parser.parse_args()
    (arguments.out / "traces").mkdir(parents=True, exist_ok=True)
    try:
        traces = arguments.out / "traces"
        fast = Network(trace="fast.csv", trace_file=traces / "fast.csv")
        (traces / "fast.csv").write_text(FAST)

        def configuration(network: Network, profile: int | str, seconds: float) -> Configuration:
            return Configuration(
                scene=SCENE, movement="stroll", network=network, mode="stateless", profile=profile,
                duration_s=seconds, width=WIDTH, height=HEIGHT, capture_every_ms=0, warm_up_s=2,
            )  # fmt: skip

        plan = Plan(
            [
                configuration(converted(network, traces), int(name) if name.isdecimal() else name, arguments.seconds)
                for network in arguments.networks
                for name in arguments.controllers
            ],
            [configuration(fast, rung, FAST_SECONDS) for rung in range(len(DEFAULT_LADDER))],
            arguments.out,
        )
        asyncio.run(measure(plan, arguments.most))
    except (StartError, TigasError, BrokenRecording, ValueError, OSError) as error:
        print(error, file=sys.stderr)
        return 1
    if plan.missing:
        print(f"{len(plan.missing)} of {len(plan.runs) + len(plan.fast)} runs are missing; the same command goes on.")
        return 3
    report(plan)
    return 0


def converted(text: str, folder: Path) -> Network:
    """A network of a trace's file, as the simulator reads it: in the project's own format. Raises ValueError."""
    network = parse_network(text)
    if network.trace_file is None:
        raise ValueError(f"{text!r} is no trace's file.")
    trace = load_trace(network.trace_file)
    path = folder / f"{trace.name}.csv"
    path.write_text(format_csv(trace), encoding="utf-8")
    return network.model_copy(update={"trace": path.name, "trace_file": path})


if __name__ == "__main__":
    sys.exit(main())
