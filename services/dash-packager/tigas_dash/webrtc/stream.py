"""One viewer's stream over WebRTC: poses come on a data channel, and views go out as a video that aiortc encodes."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Mapping
from contextlib import suppress

from aiortc import RTCDataChannel, RTCPeerConnection

from tigas_common.errors import InvalidRequest, TigasError, problem
from tigas_common.parsing import parse
from tigas_common.wire.dash import FRAMES, POSES, PoseUpdate, SentFrame, SessionStatus, WebRtcRequest, WebRtcSession
from tigas_common.wire.model import WireModel
from tigas_dash.clock import Clock
from tigas_dash.encoding import RawFrame
from tigas_dash.metrics import Transport
from tigas_dash.representation import Representation
from tigas_dash.source import ViewSource
from tigas_dash.views import NewestView, first_pose
from tigas_dash.webrtc.encoders import bound
from tigas_dash.webrtc.offer import answered
from tigas_dash.webrtc.track import ViewTrack
from tigas_dash.webrtc.udp_port import UdpPort

logger = logging.getLogger(__name__)

MOST_UNSENT = 65_536
"""Maximum bytes queued on the channel `frames`; a viewer that does not read misses the rest."""
CLOSING_S = 5
"""aiortc's closing is given up after this, in seconds."""


class WebRtcStream:
    """A running stream. Made by `WebRtc.make`; `Sessions` runs it."""

    transport: Transport = "webrtc"

    def __init__(
        self, name: str, request: WebRtcRequest, size: Representation, source: ViewSource, first: RawFrame,
        connection: RTCPeerConnection, port: UdpPort, clock: Clock,
    ) -> None:  # fmt: skip
        self.name = name
        self.used_at = clock.now()
        """Time of its last packet, on the monotonic clock."""
        self.info: WebRtcSession
        """Its description for the viewer, once it has begun."""
        self.rungs = (size.rung,)
        self._request = request
        self._size = size
        self._clock = clock
        self._connection = connection
        self._port = port
        self._started_at = clock.now()
        self._views = NewestView(name, source, first_pose(request), first, clock)
        self._track = ViewTrack(self._views, request.frame_rate, clock, self._sent)
        assert connection.sctp is not None
        self._lane = port.carry(connection.sctp.transport.transport.iceGatherer._connection, self._heard)
        self._channels: dict[str, RTCDataChannel] = {}
        self._poses = 0
        self._newest = -1
        self._ended = asyncio.Event()
        connection.add_listener("datachannel", self._opened)
        connection.add_listener("connectionstatechange", self._changed)
        self._track.add_listener("ended", self._ended.set)  # its encoder failed

    @property
    def watched(self) -> bool:
        """Always False: a present viewer keeps sending, at least receiver reports."""
        return False

    async def begin(self, host: str) -> None:
        """Answers the offer; the viewer reaches the port under `host`. Raises InvalidRequest."""
        candidate = self._port.candidate(host).to_sdp()
        sdp, codec = await answered(self._connection, self._track, candidate)
        if codec == "H264" and self._request.frame_rate != 30:
            raise InvalidRequest("aiortc encodes H.264 at 30 frames a second only: offer VP8, or ask for 30.")
        if (most := self._request.bitrate_kbps) is not None:
            (sender,) = self._connection.getSenders()
            bound(sender, codec, most * 1000)
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
    def status(self) -> SessionStatus:
        """How it does."""
        return SessionStatus(
            id=self.name,
            scene=self._request.scene,
            age_s=self._clock.now() - self._started_at,
            frames=self._track.frames,
            repeated=self._track.repeated,
            dropped=self._track.dropped,
            poses=self._poses,
            render_failures=self._views.failures,
            render_problem=self._views.problem,
            encoder_failures=0,
            watchers=int(self._connection.connectionState == "connected"),
        )

    @property
    def sent_bytes(self) -> Mapping[int, int]:
        """Of datagrams, by rung."""
        return {self._size.rung: self._lane.sent_bytes}

    @property
    def behind_s(self) -> float:
        """For how long its next frame has been due, in seconds."""
        return self._track.behind_s

    async def run(self) -> None:
        """Stream until cancelled, or until the viewer has left."""
        try:
            await self._ended.wait()
        finally:
            await self.close()

    async def close(self) -> None:
        """Release the encoder and the port, and cancel requests to the render service."""
        self._views.close()
        self._track.stop()
        with suppress(TimeoutError, AttributeError):  # aiortc's, of an offer that it took in part
            async with asyncio.timeout(CLOSING_S):
                await self._connection.close()
        self._lane.leave()

    def _heard(self) -> None:
        self.used_at = self._clock.now()

    def _changed(self) -> None:
        if self._connection.connectionState in ("failed", "closed"):
            self._ended.set()

    def _opened(self, channel: RTCDataChannel) -> None:
        if channel.label in (POSES, FRAMES):
            self._channels[channel.label] = channel
        if channel.label == POSES:
            channel.add_listener("message", self._told)

    def _told(self, message: str | bytes) -> None:
        """The viewer's camera, perhaps overtaken: the channel is unordered."""
        try:
            pose = parse(PoseUpdate, message.encode() if isinstance(message, str) else message)
        except TigasError as error:
            self._tell(problem(error))
            return
        self._poses += 1
        if pose.seq >= self._newest:
            self._newest = pose.seq
            self._views.move(pose)

    def _sent(self, timestamp: int, pose: int) -> None:
        first = self._lane.first_rtp_timestamp
        if first is not None:  # else it was not sent after all
            self._tell(SentFrame(rtp_timestamp=(first + timestamp) % 2**32, pose=pose))

    def _tell(self, message: WireModel) -> None:
        channel = self._channels.get(FRAMES)
        if channel is not None and channel.readyState == "open" and channel.bufferedAmount < MOST_UNSENT:
            channel.send(message.model_dump_json())
