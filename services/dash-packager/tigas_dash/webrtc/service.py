"""Opens streams over WebRTC: an offer in, a stream with its answer out."""

from __future__ import annotations

import secrets
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from tigas_common.address import Address, is_loopback
from tigas_common.wire.dash import WebRtcRequest
from tigas_dash.clock import Clock
from tigas_dash.errors import WebRtcUnavailable
from tigas_dash.representation import single_size
from tigas_dash.source import RenderClient, ViewSource
from tigas_dash.webrtc.offer import taken, widen_bitrates
from tigas_dash.webrtc.stream import WebRtcStream
from tigas_dash.webrtc.udp_port import UdpPort


class WebRtc:
    """State shared by all WebRTC streams; opened by `running`."""

    def __init__(self, client: RenderClient, port: UdpPort, clock: Clock, *, on_loopback: bool) -> None:
        """on_loopback: only this machine reaches the port, although a render service proxies requests of others."""
        self._client = client
        self._on_loopback = on_loopback
        self._port = port
        self._clock = clock

    @classmethod
    @asynccontextmanager
    async def running(cls, client: RenderClient, address: Address, clock: Clock) -> AsyncIterator[WebRtc]:
        """Listen, as a context manager. Raises OSError."""
        widen_bitrates()
        async with UdpPort().running(address) as port:
            yield cls(client, port, clock, on_loopback=address.is_loopback)

    @property
    def port_number(self) -> int:
        return self._port.number

    async def make(self, request: WebRtcRequest, host: str) -> WebRtcStream:
        """A stream with its first frame rendered, not running yet; its viewer reached this service at `host`.

        Raises InvalidRequest, RenderUnavailable, RenderProblem, and WebRtcUnavailable for a viewer on another machine
        that cannot reach the port.
        """
        if self._on_loopback and not is_loopback(host):
            raise WebRtcUnavailable(
                "This packager sends WebRTC to its own machine alone; --http 0.0.0.0:8081 opens it."
            )
        async with taken(request.sdp) as connection:
            size = single_size(request, await self._client.ladder(request.scene), request.rung)
            source = ViewSource(self._client, request, size)
            first, name = await source.first(), secrets.token_hex(8)
            stream = WebRtcStream(name, request, size, source, first, connection, self._port, self._clock)
            try:
                await stream.begin(host)
            except BaseException:
                await stream.close()
                raise
            return stream
