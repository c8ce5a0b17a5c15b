"""What many viewers need: GPUs, hosts, network, and how near. Prints the tables of docs/scale.md.

    python -m benchmarks.scale [--viewers 10000 1000000] [--gpus 1 --cores 16 --gbit 25] [--regions regions.toml]

Arithmetic on figures that were measured, which the first table names. docs/scale.md says what it leaves out.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from benchmarks.scale import measured
from benchmarks.scale.model import Host, workloads
from benchmarks.scale.tables import measured_table, need_table, reach_table, read_regions, region_table, viewer_table


def main(given: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--viewers", type=int, nargs="+", default=[10_000, 1_000_000], help="at the same time")
    parser.add_argument("--gpus", type=int, default=1, help="of a host (default: 1)")
    parser.add_argument("--cores", type=int, default=16, help="of a host (default: 16)")
    parser.add_argument("--gbit", type=float, default=25, help="a second that a host sends at most (default: 25)")
    parser.add_argument(
        "--utilisation", type=float, default=measured.READMIT.value, help="planned with (default: %(default)s)"
    )
    parser.add_argument("--regions", type=Path, default=Path(__file__).with_name("regions.toml"), help="where they are")
    arguments = parser.parse_args(given)
    host = Host(arguments.gpus, arguments.cores, arguments.gbit, arguments.utilisation)
    page = workloads()[-1]
    try:
        print(
            measured_table(),
            viewer_table(workloads(), host),
            need_table(workloads(), host, arguments.viewers),
            reach_table(),
            region_table(max(arguments.viewers), page, host, read_regions(arguments.regions)),
            sep="\n\n",
        )
    except ValueError as error:
        print(error, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
