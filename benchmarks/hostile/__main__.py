"""One polite viewer before, during and after each attack from another address.

    python -m benchmarks.hostile [--only NAME]... [--seconds 10] [--device cuda]

Each attack targets newly started services on loopback, over a small scene. The viewer requests 30 frames/s at the
lowest rung from 127.0.0.2, the attacker comes from 127.0.0.3. Goal, for every polite client: a p95 during the attack of
at most twice the p95 alone and 20 ms, memory within 5 % of its initial value 30 s later, nothing lost. Exits with 1 if
an attack misses it. Linux; attacks on the shaper need root and are left out without it.
"""

from __future__ import annotations

import argparse
import math
import os
import platform
import signal
import sys

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from benchmarks.hostile.attacks import ATTACKS
from benchmarks.hostile.measure import Cores, Outcome, Times, measure
from benchmarks.hostile.services import plug_in
from tigas_common.installation import this_commit

ISOLATED = "--isolated"


def show(outcomes: list[Outcome]) -> Table:
    """A row for every polite client during each attack."""
    table = Table(title="Polite p50 / p95 in ms, lost, and memory of the attacked service in MB")
    table.add_column("attack", no_wrap=True)
    table.add_column("polite", no_wrap=True)
    for heading in ("before", "during", "after", "lost", "memory before, peak, after"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("verdict")
    for outcome in outcomes:
        memory = outcome.memory
        for number, polite in enumerate(outcome.polite):
            faults = [*polite.faults, *([] if number else outcome.faults)]
            table.add_row(
                "" if number else outcome.attack.name,
                polite.who,
                *map(_times, (polite.before, polite.during, polite.after)),
                f"{polite.during.lost + polite.after.lost} of {polite.during.asked + polite.after.asked}",
                "" if number else f"{memory.before:.0f}, {memory.peak:.0f}, {memory.after:.0f}",
                f"[red]{', '.join(faults)}" if faults else "[green]holds",
                end_section=number == len(outcome.polite) - 1,
            )
    return table


def _times(times: Times) -> str:
    return " / ".join("never" if math.isinf(one) else f"{one:.1f}" for one in (times.p50, times.p95))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", action="append", choices=[one.name for one in ATTACKS], metavar="NAME", default=[])
    parser.add_argument("--seconds", type=float, default=10, help="of each attack, and of the time before it")
    parser.add_argument("--device", choices=["cpu", "cuda"], default="cpu", help="device of the render service")
    parser.add_argument(ISOLATED, action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # so that the services end as well
    if os.geteuid() == 0 and not arguments.isolated:
        command = [sys.executable, "-m", "benchmarks.hostile", ISOLATED, *sys.argv[1:]]
        os.execvp("unshare", ["unshare", "--net", "--", *command])  # where the shaper can shape
    if arguments.isolated:
        plug_in()
    console = Console(width=150 if not sys.stdout.isatty() else None)
    attacks = [one for one in ATTACKS if not arguments.only or one.name in arguments.only]
    if not arguments.isolated:
        console.print("Not root: the attacks on the shaper are left out.")
        attacks = [one for one in attacks if one.service != "shaper"]
    cores, outcomes = Cores.share(), []
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    try:
        with Progress(*columns, console=Console(stderr=True)) as progress:
            task = progress.add_task("", total=len(attacks))
            for attack in attacks:

                def tell(phase: str, name: str = attack.name) -> None:
                    progress.update(task, description=f"{name}: {phase}")

                outcome = measure(attack, arguments.seconds, cores, arguments.device, tell)
                outcomes.append(outcome)
                done = ", ".join(f"{count:,} {kind}" for kind, count in sorted(outcome.done.items())) or "unknown"
                console.print(f"{attack.name}: {done}", highlight=False)
                progress.advance(task)
    finally:  # results before an interruption count
        console.print(show(outcomes))
        console.print(
            f"Commit {this_commit() or 'unknown'}, {platform.machine()}, {os.cpu_count()} cores: {len(cores.services)} "
            f"for the services, {len(cores.clients)} for viewer and attacker."
        )
    return int(not all(outcome.holds for outcome in outcomes))


if __name__ == "__main__":
    sys.exit(main())
