"""Carries out an attack until stopped.

Prints a line when it begins, and its counters at the end: an attack that did nothing proves nothing.
"""

from __future__ import annotations

import asyncio
import json
import os
import signal
import sys

from benchmarks.hostile import http1, http3
from benchmarks.hostile.attacker import ATTACKS, Attack, Attacker
from benchmarks.hostile.services import Ports

__all__ = ["ATTACKS", "Attack", "http1", "http3"]


async def main(attack: Attack, ports: Ports) -> None:
    """Carry out an attack until SIGTERM, and then go without a word to the services."""
    attacker = Attacker(ports)

    def stop(*_: object) -> None:
        print(json.dumps(attacker.done), flush=True)
        os._exit(0)

    signal.signal(signal.SIGTERM, stop)  # the loop may be too busy to notice
    print("begun", flush=True)
    await attack.run(attacker)


if __name__ == "__main__":
    os.sched_setaffinity(0, set(map(int, sys.argv[2].split(","))))
    os.nice(19)
    (chosen,) = (one for one in ATTACKS if one.name == sys.argv[3])
    asyncio.run(main(chosen, Ports.parse(sys.argv[1])))
