"""The scenes of all hosts: loaded if any host has loaded them, and unloaded everywhere."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from contextlib import suppress
from urllib.parse import quote

import httpx

from tigas_cluster.fleet import HostState
from tigas_cluster.host_proxy import AWAY, RETRY_S
from tigas_common.errors import Overloaded, TigasError
from tigas_common.parsing import parse
from tigas_common.placement import merged_scenes
from tigas_common.wire.render import SceneInfo

ANSWER_S = 4.0
"""Seconds for a host to list its scenes, or be left out; the page waits for 5 s."""
MAX_LIST = 10_000_000
"""The longest list of scenes that is read, in bytes."""


async def list_scenes(client: httpx.AsyncClient, hosts: Sequence[HostState], *, scan: bool) -> list[SceneInfo]:
    """Return the scenes of all hosts, by id. Raises Overloaded if no host answers."""
    target = "/scenes?scan=1" if scan else "/scenes"
    lists = await asyncio.gather(*(_scenes_of(client, host.api_url + target) for host in hosts))
    answered = [each for each in lists if each is not None]
    if not answered:
        raise Overloaded(AWAY, RETRY_S)
    return merged_scenes(answered)


async def unload(client: httpx.AsyncClient, hosts: Sequence[HostState], scene: str) -> httpx.Response:
    """Unload a scene wherever it is loaded, and return the answer of a host that refused, or else the last one.

    Raises Overloaded if a host does not answer.
    """
    answer: httpx.Response | None = None
    for host in [each for each in hosts if scene in each.load.scenes] or hosts[:1]:
        try:
            answer = await client.post(f"{host.api_url}/scenes/{quote(scene, safe='')}/unload", timeout=ANSWER_S)
        except httpx.TransportError as error:
            raise Overloaded(AWAY, RETRY_S) from error
        if answer.is_error:
            break
    if answer is None:
        raise Overloaded(AWAY, RETRY_S)
    return answer


async def _scenes_of(client: httpx.AsyncClient, url: str) -> list[SceneInfo] | None:
    with suppress(TimeoutError, httpx.HTTPError, TigasError):
        async with asyncio.timeout(ANSWER_S):
            answer = await client.get(url)
        return parse(list[SceneInfo], answer.raise_for_status().content, MAX_LIST)
    return None
