"""From a viewer's offer to an answer: one video to send and one data transport, on one connection through our port."""

from __future__ import annotations

import re
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress

from aiortc import MediaStreamTrack, RTCConfiguration, RTCPeerConnection, RTCSessionDescription
from aiortc.codecs import h264, vpx
from aiortc.exceptions import OperationError

from tigas_common.errors import InvalidRequest

MIN_BPS, MAX_BPS = 100_000, 10_000_000
"""What congestion control may ask encoders for."""
NO_SDP = "The offer is no SDP of a WebRTC connection."
_CANDIDATES = re.compile(r"^a=(candidate:|end-of-candidates).*(\r\n|\n|$)", re.MULTILINE)
_CODEC = re.compile(r"^a=rtpmap:\d+ ([\w-]+)/", re.MULTILINE)


def widen_bitrates() -> None:
    """aiortc holds H.264 between 0.5 and 3 Mbit/s, and VP8 between 0.25 and 1.5: too narrow for the links here."""
    for codec in (h264, vpx):
        vars(codec).update(MIN_BITRATE=MIN_BPS, MAX_BITRATE=MAX_BPS)


@asynccontextmanager
async def taken(offer: str) -> AsyncIterator[RTCPeerConnection]:
    """A connection that has taken an offer; closed if what follows fails. Raises InvalidRequest."""
    media = re.findall(r"^m=(\w+)", offer, re.MULTILINE)
    if sorted(media) != ["application", "video"]:
        raise InvalidRequest("The offer must have one video and one data transport, and nothing else.")
    connection = RTCPeerConnection(RTCConfiguration(iceServers=[]))
    try:
        await _take(connection, offer)
        yield connection
    except BaseException:
        with suppress(AttributeError):  # aiortc's, of what it took in part
            await connection.close()
        raise


async def _take(connection: RTCPeerConnection, offer: str) -> None:
    # Where the viewer can be reached is where it is heard from: see `udp_port`.
    description = RTCSessionDescription(sdp=_CANDIDATES.sub("", offer), type="offer")
    try:
        await connection.setRemoteDescription(description)
        (video,) = connection.getTransceivers()
        assert connection.sctp is not None
        bundled = video.receiver.transport is connection.sctp.transport
    except OperationError:
        raise InvalidRequest("The offer has no video codec that can be sent here: H.264 (baseline) or VP8.") from None
    except Exception:  # aiortc checks little of what it parses
        raise InvalidRequest(NO_SDP) from None
    if not bundled:
        raise InvalidRequest("The offer must have its video and its data on one transport (BUNDLE).")


async def answered(connection: RTCPeerConnection, track: MediaStreamTrack, candidate: str) -> tuple[str, str]:
    """Answers the offer that was taken: the SDP with this candidate, and the codec's name. Raises InvalidRequest."""
    (video,) = connection.getTransceivers()
    connection.addTrack(track)
    video.direction = "sendonly"
    try:
        await connection.setLocalDescription(await connection.createAnswer())
    except Exception:  # as in `_take`
        raise InvalidRequest(NO_SDP) from None
    codec = _CODEC.search(connection.localDescription.sdp)
    if video.currentDirection != "sendonly" or codec is None:
        raise InvalidRequest("The offer does not ask for a video.")
    sdp = re.sub("a=candidate:.*", f"a=candidate:{candidate}\r", connection.localDescription.sdp)
    return sdp, codec[1]
