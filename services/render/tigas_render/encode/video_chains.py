"""Videos of viewers, as chains of frames that each refer to the previous one. Thread-safe.

This is the only state that the service keeps per viewer. It may be dropped at any time, which costs a key frame.
"""

from __future__ import annotations

import threading
from collections import OrderedDict, defaultdict
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

from tigas_common.errors import Superseded
from tigas_common.wire.render import VideoInfo, VideoRequest
from tigas_render.encode.h264 import H264Encoder
from tigas_render.frame import Client

MAX_ENCODERS: Final = 64
"""Default maximum number of concurrent encoders."""
REFERENCE_PIXELS: Final = 1280 * 720
"""Size above which a video counts as several; an encoder of this size takes about 20 MB."""
STILL_S: Final = 1.0
"""Seconds without a request after which a viewer is standing still, and may continue with a key frame."""
IDLE_S: Final = 10.0
"""Seconds without a request after which a viewer gets a new chain."""


@dataclass(slots=True, eq=False)
class VideoChain:
    """One viewer's chain. `lock` is held while a frame is encoded."""

    used_at: float
    weight: float = 1
    """Number of encoders as which it counts."""
    lock: threading.Lock = field(default_factory=threading.Lock)
    encoder: H264Encoder | None = None
    last_seq: int | None = None
    """Number of the frame to which the next one can refer."""
    key_frame_seq: int = 0
    """Number of the last key frame."""
    is_broken: bool = False
    """Whether the next frame must be a key frame, because the viewer does not get the last one."""

    def encode(self, seq: int, video: VideoRequest, width: int, height: int, planes: bytes) -> tuple[bytes, VideoInfo]:
        """Implementation of `VideoChains.encode`. The caller must hold the lock."""
        if self.last_seq is not None and seq < self.last_seq and not video.key:
            raise Superseded("A newer view of this client has been encoded already.")
        bits = 1000 * video.bitrate_kbps / video.frames_per_s
        encoder = self.encoder
        if encoder is None or not encoder.fits(width, height, bits):
            self.encoder = None
            encoder = H264Encoder(width, height, bits)
            self.last_seq = None
        key = self.last_seq is None or video.key or self.is_broken
        if key:
            self.key_frame_seq, self.is_broken = seq, False
        self.encoder = None  # not reused if it fails
        body, codec = encoder.encode(planes, bits, key=key)
        self.encoder = encoder
        after, self.last_seq = None if key else self.last_seq, seq
        return body, VideoInfo(key=key, after=after, codec=codec)


class VideoChains:
    """All chains of one engine."""

    def __init__(self, max_encoders: int, clock: Callable[[], float]) -> None:
        """max_encoders: above it, the address with the most encoders loses its least recently used chain.

        If it has only one, a large video, the chain that has been at rest for longest is dropped instead, if any.
        """
        self._max_encoders = max_encoders
        self._clock = clock
        self._chains: OrderedDict[Client, VideoChain] = OrderedDict()
        """Chains by client, in the order of their last request."""
        self._lock = threading.Lock()

    def __len__(self) -> int:
        return len(self._chains)

    def encode(
        self, client: Client, seq: int, video: VideoRequest, width: int, height: int, planes: bytes
    ) -> tuple[bytes, VideoInfo]:
        """Encode the next frame of a viewer's video, from planes of `encode_yuv420p`. Also returns its place there.

        Waits for the previous frame. Raises Superseded if a later one has been encoded already, and EncodingFailed.
        """
        chain = self._chain(client, max(1, width * height / REFERENCE_PIXELS))
        with chain.lock:
            return chain.encode(seq, video, width, height, planes)

    def mark_lost(self, client: Client, seq: int) -> None:
        """Record that an encoded frame was not delivered, so that no later one may refer to it. Does not block."""
        with self._lock:
            chain = self._chains.get(client)
            if chain is not None and seq >= chain.key_frame_seq:
                chain.is_broken = True

    def forget(self, client: Client) -> None:
        """Drop a viewer's chain, so that its next frame starts a new one."""
        with self._lock:
            self._chains.pop(client, None)

    def forget_idle(self) -> None:
        with self._lock:
            while self._chains:
                client, chain = next(iter(self._chains.items()))
                if self._clock() - chain.used_at < IDLE_S:
                    return
                del self._chains[client]

    def _chain(self, client: Client, weight: float) -> VideoChain:
        self.forget_idle()
        with self._lock:
            chain = self._chains.get(client)
            if chain is None:
                chain = self._chains[client] = VideoChain(self._clock())
            self._chains.move_to_end(client)
            chain.used_at, chain.weight = self._clock(), weight
            self._evict()
            return chain

    def _evict(self) -> None:
        while len(self._chains) > 1 and sum(chain.weight for chain in self._chains.values()) > self._max_encoders:
            of_address: defaultdict[str, float] = defaultdict(float)
            for client, chain in self._chains.items():
                of_address[client.address] += chain.weight
            heaviest = max(of_address, key=of_address.__getitem__)
            victim, *others = [client for client in self._chains if client.address == heaviest]
            oldest, chain = next(iter(self._chains.items()))
            if not others and self._clock() - chain.used_at >= STILL_S:
                victim = oldest
            del self._chains[victim]
