"""The attacks, each from one address: the code to run, its target, and the polite clients to measure.

As a program it carries out one of them until stopped. It prints a line when it begins, and its counters at the end: an
attack that did nothing proves nothing.
"""

from __future__ import annotations

import asyncio
import json
import os
import signal
import sys
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from functools import partial

from benchmarks.hostile import http1, http3, uploads
from benchmarks.hostile.attacker import Attacker
from benchmarks.hostile.services import Name, Ports


@dataclass(frozen=True, slots=True)
class Attack:
    """One of them."""

    name: str
    run: Callable[[Attacker], Awaitable[None]]
    """Goes on until it is cancelled."""
    service: Name = "render"
    """The service that is measured for memory."""
    guests: tuple[str, ...] = ()
    """Polite clients in addition to the viewer: a newcomer, or visitors of the page or of a service."""


ATTACKS = (
    Attack("qpack-bomb", http3.qpack_bomb),
    Attack("endless-frames", http3.endless_frames),
    Attack("endless-settings", http3.endless_settings),
    Attack("request-flood", http3.request_flood),
    Attack("datagram-flood", http3.datagram_flood),
    Attack("slow-readers", http3.slow_readers),
    Attack("16-megapixels", http3.sixteen_megapixels),
    Attack("many-sessions", http3.many_sessions, guests=("newcomer",)),
    Attack("abandoned-streams", http3.abandoned_streams),
    Attack("stream-resets", http3.stream_resets, guests=("newcomer",)),
    Attack("datagram-pictures", http3.datagram_pictures),
    Attack("new-videos", http3.new_videos),
    Attack("unfinished-requests", http3.unfinished_requests),
    Attack("handshake-flood", http3.handshake_flood, guests=("newcomer",)),
    Attack("connection-hoard", http3.connection_hoard, guests=("newcomer",)),
    Attack("page-flood", http1.page_flood, guests=("page",)),
    *(
        Attack(f"{name}-flood", partial(http1.get_flood, path), guests=("page",))
        for name, path in (("openapi", "/openapi.json"), ("scan", "/scenes?scan=1"), ("metrics", "/metrics"))
    ),
    Attack("unload-scene", http1.unload_scene, guests=("page",)),
    *(
        Attack(f"slow-headers-{name}", partial(http1.slow_headers, name), name, ("page" if name == "render" else name,))
        for name in ("render", "dash", "store", "shaper")
    ),
    Attack("slow-bodies", http1.slow_bodies, guests=("page",)),
    Attack("streams-left", http1.streams_left, "dash", ("dash",)),
    Attack("large-messages", http1.large_messages, "dash", ("dash",)),
    Attack("watchers", http1.watchers, "shaper", ("shaper",)),
    Attack("error-bomb", uploads.error_bomb, "store", ("store",)),
    Attack("deep-json", uploads.deep_json, "store", ("store",)),
    Attack("large-uploads", uploads.large_uploads, "store", ("store",)),
    Attack("gzip-bomb", uploads.gzip_bomb, "shaper", ("shaper",)),
)


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
