"""Streams over WebRTC: poses arrive on a data channel, and views are sent as video by aiortc."""

from __future__ import annotations

import asyncio
import logging
import secrets
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress

from aiortc import RTCDataChannel, RTCPeerConnection

from tigas_common.address import Address, is_loopback
from tigas_common.errors import InvalidRequest, TigasError, problem
from tigas_common.parsing import parse
from tigas_common.render_requests import RenderClient
from tigas_common.wire.dash import FRAMES, POSES, PoseUpdate, SentFrame, WebRtcRequest, WebRtcSession
from tigas_common.wire.model import WireModel
from tigas_dash.clock import Clock
from tigas_dash.encoder import RawFrame
from tigas_dash.errors import WebRtcUnavailable
from tigas_dash.representation import Representation, choose_representation
from tigas_dash.source import ViewSource, fetch_ladder
from tigas_dash.stream import Stream
from tigas_dash.webrtc.offer import accept_offer, create_answer, limit_bitrate, widen_bitrates
from tigas_dash.webrtc.track import ViewTrack
from tigas_dash.webrtc.udp_port import UdpPort

logger = logging.getLogger(__name__)

MAX_BUFFERED = 65_536
"""Maximum number of bytes queued on the channel `frames`; a viewer that does not read misses the rest."""
CLOSE_TIMEOUT_S = 5
"""Seconds after which waiting for aiortc to close is abandoned."""


class WebRtcStream(Stream):
    """A stream made by `WebRtcServer.create_stream`. A live viewer keeps sending at least receiver reports."""

    transport = "webrtc"
    _request: WebRtcRequest

    def __init__(
        self, name: str, request: WebRtcRequest, size: Representation, source: ViewSource, first: RawFrame,
        connection: RTCPeerConnection, port: UdpPort, clock: Clock,
    ) -> None:  # fmt: skip
        super().__init__(name, request, (size.rung,), source, first, clock)
        self.info: WebRtcSession
        """Description of the stream for the viewer, once it has begun."""
        self._size = size
        self._connection = connection
        self._port = port
        self._track = ViewTrack(self._views, request.frame_rate, clock, self.progress, self._on_frame_sent)
        assert connection.sctp is not None
        ice = connection.sctp.transport.transport.iceGatherer._connection
        self._lane = port.attach(ice, self._datagram_received, self._datagram_sent)
        self._channels: dict[str, RTCDataChannel] = {}
        self._newest = -1
        self._ended = asyncio.Event()
        connection.add_listener("datachannel", self._on_channel)
        connection.add_listener("connectionstatechange", self._on_state_change)
        self._track.add_listener("ended", self._ended.set)  # when its encoder fails

    async def answer(self, host: str) -> None:
        """Answer the offer; the viewer reaches the port under `host`. Raises InvalidRequest."""
        candidate = self._port.candidate(host).to_sdp()
        sdp, codec = await create_answer(self._connection, self._track, candidate)
        if codec == "H264" and self._request.frame_rate != 30:
            raise InvalidRequest("aiortc encodes H.264 only at 30 frames a second: offer VP8, or request 30.")
        if (most := self._request.bitrate_kbps) is not None:
            (sender,) = self._connection.getSenders()
            limit_bitrate(sender, codec, most * 1000)
        size = self._size
        self.info = WebRtcSession(
            id=self.name,
            sdp=sdp,
            codec=codec,
            rung=size.rung,
            width=size.width,
            height=size.height,
            frame_rate=self._request.frame_rate,
        )

    @property
    def watchers(self) -> int:
        return int(self._connection.connectionState == "connected")

    @property
    def behind_s(self) -> float:
        return self._track.behind_s

    async def run(self) -> None:
        try:
            await self._ended.wait()
        finally:
            await self.close()

    async def close(self) -> None:
        """Release the encoder and the port, and cancel requests to the render service."""
        self._views.close()
        self._track.stop()
        try:
            with suppress(TimeoutError, AttributeError):  # raised by aiortc for an offer accepted in part
                async with asyncio.timeout(CLOSE_TIMEOUT_S):
                    await self._connection.close()
        finally:
            self._lane.detach()

    def _datagram_received(self) -> None:
        self.used_at = self._clock.now()

    def _datagram_sent(self, size: int) -> None:
        self.sent_bytes[self._size.rung] += size

    def _on_state_change(self) -> None:
        if self._connection.connectionState in ("failed", "closed"):
            self._ended.set()

    def _on_channel(self, channel: RTCDataChannel) -> None:
        if channel.label in (POSES, FRAMES):
            self._channels[channel.label] = channel
        if channel.label == POSES:
            channel.add_listener("message", self._on_pose)

    def _on_pose(self, message: str | bytes) -> None:
        """Handle a pose of the viewer, which may be outdated as the channel is unordered."""
        try:
            pose = parse(PoseUpdate, message.encode() if isinstance(message, str) else message)
        except TigasError as error:
            self._send(problem(error))
            return
        self._poses += 1
        if pose.seq >= self._newest:
            self._newest = pose.seq
            self._views.set_pose(pose)

    def _on_frame_sent(self, timestamp: int, pose: int) -> None:
        first = self._lane.first_rtp_timestamp
        if first is not None:  # otherwise the frame was not sent after all
            self._send(SentFrame(rtp_timestamp=(first + timestamp) % 2**32, pose=pose))

    def _send(self, message: WireModel) -> None:
        channel = self._channels.get(FRAMES)
        if channel is not None and channel.readyState == "open" and channel.bufferedAmount < MAX_BUFFERED:
            channel.send(message.model_dump_json())


class WebRtcServer:
    """State shared by all WebRTC streams; opened by `listen`."""

    def __init__(self, client: RenderClient, port: UdpPort, clock: Clock, *, on_loopback: bool) -> None:
        """on_loopback: only this machine reaches the port, although a render service may proxy others' requests."""
        self._client = client
        self._on_loopback = on_loopback
        self._port = port
        self._clock = clock

    @classmethod
    @asynccontextmanager
    async def listen(cls, client: RenderClient, address: Address, clock: Clock) -> AsyncIterator[WebRtcServer]:
        """Listen, as a context manager. Raises OSError."""
        widen_bitrates()
        async with UdpPort.listen(address) as port:
            yield cls(client, port, clock, on_loopback=address.is_loopback)

    @property
    def port_number(self) -> int:
        return self._port.number

    async def create_stream(self, request: WebRtcRequest, host: str) -> WebRtcStream:
        """Create a stream, not yet running, and render its first frame; its viewer reached this service at `host`.

        Raises InvalidRequest, RenderUnavailable, RenderProblem, and WebRtcUnavailable for a viewer on another machine
        that cannot reach the port.
        """
        if self._on_loopback and not is_loopback(host):
            raise WebRtcUnavailable(
                "This packager sends WebRTC only to its own machine; open it with --http 0.0.0.0:8081."
            )
        async with accept_offer(request.sdp) as connection:
            size = choose_representation(request, await fetch_ladder(self._client, request.scene), request.rung)
            source = ViewSource(self._client, request, size)
            first, name = await source.first_frame(), secrets.token_hex(8)
            stream = WebRtcStream(name, request, size, source, first, connection, self._port, self._clock)
            try:
                await stream.answer(host)
            except BaseException:
                await stream.close()
                raise
            return stream
