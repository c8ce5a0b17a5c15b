"""The attacks, each from one address: what is run, on which service, and who else is there to notice."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from functools import partial

from benchmarks.hostile import http1, http3, uploads
from benchmarks.hostile.attacker import Attacker
from benchmarks.hostile.services import Name


@dataclass(frozen=True, slots=True)
class Attack:
    """One of them."""

    name: str
    run: Callable[[Attacker], Awaitable[None]]
    """Goes on until it is cancelled."""
    service: Name = "render"
    """Whose memory is watched."""
    guests: tuple[str, ...] = ()
    """Who is polite beside the viewer: a newcomer, or visitors of the page or of a service."""


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
    Attack("unfinished-requests", http3.unfinished_requests),
    Attack("handshake-flood", http3.handshake_flood, guests=("newcomer",)),
    Attack("connection-hoard", http3.connection_hoard, guests=("newcomer",)),
    Attack("page-flood", http1.page_flood, guests=("page",)),
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
