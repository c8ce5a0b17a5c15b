"""A viewer over WebRTC that is no browser: aiortc at the other end."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from typing import Any

import av
import httpx
from aiortc import RTCConfiguration, RTCPeerConnection, RTCSessionDescription
from aiortc.mediastreams import MediaStreamTrack

from tests.dash.conftest import session_request

CONNECTING_S = 5


def webrtc_request(sdp: str, **changes: Any) -> dict[str, Any]:
    request = session_request(sdp=sdp, rung=3, **changes)
    return {name: value for name, value in request.items() if name not in ("representations", "segment_s")}


class Viewer:
    def __init__(self) -> None:
        self.connection = RTCPeerConnection(RTCConfiguration(iceServers=[]))
        self.connection.addTransceiver("video", direction="recvonly")
        self.poses = self.connection.createDataChannel("poses", ordered=False, maxRetransmits=0)
        self.frames = self.connection.createDataChannel("frames", ordered=False)
        self.told: list[dict[str, Any]] = []
        self.pictures: list[av.VideoFrame] = []
        self._watching: asyncio.Task[None] | None = None
        self._answered = False
        self._changed = asyncio.Event()
        self.connection.add_listener("connectionstatechange", self._changed.set)
        self.connection.add_listener("track", self._track)
        self.frames.add_listener("message", lambda message: self.told.append(json.loads(message)))

    async def offer(self) -> str:
        await self.connection.setLocalDescription(await self.connection.createOffer())
        return self.connection.localDescription.sdp

    async def take(self, answer: str) -> None:
        self._answered = True
        await self.connection.setRemoteDescription(RTCSessionDescription(sdp=answer, type="answer"))

    def _track(self, track: MediaStreamTrack) -> None:
        async def watch() -> None:
            while True:
                picture = await track.recv()
                assert isinstance(picture, av.VideoFrame)
                self.pictures.append(picture)

        self._watching = asyncio.ensure_future(watch())

    async def leave(self) -> None:
        """Close like a page. aiortc's connecting must have ended, because its task would fail on a closed transport."""
        if self._watching is not None:
            self._watching.cancel()
        if self._answered:
            with suppress(TimeoutError):
                async with asyncio.timeout(CONNECTING_S):
                    while self.connection.connectionState in ("new", "connecting"):
                        self._changed.clear()
                        await self._changed.wait()
        await self.connection.close()


@asynccontextmanager
async def watching(http: httpx.AsyncClient, **changes: Any) -> AsyncIterator[tuple[Viewer, dict[str, Any]]]:
    """A viewer with an open stream and its description, as a context manager."""
    viewer = Viewer()
    try:
        answer = await http.post("/webrtc", json=webrtc_request(await viewer.offer(), **changes))
        assert answer.status_code == 201, answer.text
        session: dict[str, Any] = answer.json()
        await viewer.take(session["sdp"])
        yield viewer, session
    finally:
        await viewer.leave()


async def offer_of_nobody() -> str:
    """An offer of a viewer that has left."""
    viewer = Viewer()
    offer = await viewer.offer()
    await viewer.leave()
    return offer
