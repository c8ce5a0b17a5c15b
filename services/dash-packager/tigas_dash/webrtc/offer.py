"""Answers to viewers' offers: one video to send and one data transport, on one connection through our port."""

from __future__ import annotations

import re
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress

from aiortc import MediaStreamTrack, RTCConfiguration, RTCPeerConnection, RTCRtpSender, RTCSessionDescription
from aiortc.codecs import h264, vpx
from aiortc.exceptions import OperationError
from aiortc.rtcdtlstransport import X509_DIGEST_ALGORITHMS
from aiortc.sdp import SessionDescription

from tigas_common.errors import InvalidRequest

MIN_BPS, MAX_BPS = 100_000, 10_000_000
"""Range of bit rates that congestion control may set on encoders."""
MIN_MESSAGE_SIZE = 1024
"""Minimum size in bytes of messages that a viewer must accept on the data channel."""
UNLIMITED = 0
"""Maximum message size that means any size (RFC 8841, 6.1)."""
NO_SDP = "The offer is not SDP of a WebRTC connection."
_CANDIDATES = re.compile(r"^a=(candidate:|end-of-candidates).*(\r\n|\n|$)", re.MULTILINE)
_CODEC = re.compile(r"^a=rtpmap:\d+ ([\w-]+)/", re.MULTILINE)


def widen_bitrates() -> None:
    """Widen aiortc's ranges of 0.5 to 3 Mbit/s for H.264 and 0.25 to 1.5 for VP8, too narrow for the links here."""
    for codec in (h264, vpx):
        vars(codec).update(MIN_BITRATE=MIN_BPS, MAX_BITRATE=MAX_BPS)


class _BitrateLimit:
    """Mixin that limits the bit rate of one of aiortc's encoders; it must come first in the base classes."""

    max_bps: int

    @property
    def target_bitrate(self) -> int:
        """Bit rate set by congestion control, up to the limit."""
        wanted: int = super().target_bitrate  # type: ignore[misc]
        return min(wanted, self.max_bps)

    @target_bitrate.setter
    def target_bitrate(self, bitrate: int) -> None:
        super(_BitrateLimit, type(self)).target_bitrate.__set__(self, bitrate)  # type: ignore[misc]


class _LimitedH264(_BitrateLimit, h264.H264Encoder):
    pass


class _LimitedVp8(_BitrateLimit, vpx.Vp8Encoder):
    pass


def limit_bitrate(sender: RTCRtpSender, codec: str, max_bps: int) -> None:
    """Limit the bit rate of a sender, before its first frame, on any link."""
    encoder = _LimitedH264() if codec == "H264" else _LimitedVp8()
    encoder.max_bps = max_bps
    vars(sender)["_RTCRtpSender__encoder"] = encoder


@asynccontextmanager
async def accept_offer(offer: str) -> AsyncIterator[RTCPeerConnection]:
    """A connection that has accepted an offer, as a context manager; closed on errors. Raises InvalidRequest."""
    media = re.findall(r"^m=(\w+)", offer, re.MULTILINE)
    if sorted(media) != ["application", "video"]:
        raise InvalidRequest("The offer must have one video and one data transport, and nothing else.")
    connection = RTCPeerConnection(RTCConfiguration(iceServers=[]))
    try:
        await _set_offer(connection, offer)
        yield connection
    except BaseException:
        with suppress(AttributeError):  # raised by aiortc after a partial success
            await connection.close()
        raise


async def _set_offer(connection: RTCPeerConnection, offer: str) -> None:
    # Candidates are removed, as viewers are reached at the address of their packets: see `udp_port`.
    description = RTCSessionDescription(sdp=_CANDIDATES.sub("", offer), type="offer")
    try:
        _check_offer(SessionDescription.parse(description.sdp))
        await connection.setRemoteDescription(description)
        (video,) = connection.getTransceivers()
        assert connection.sctp is not None
        bundled = video.receiver.transport is connection.sctp.transport
    except InvalidRequest:
        raise
    except OperationError:
        raise InvalidRequest("The offer has no video codec that can be sent: H.264 (baseline) or VP8.") from None
    except Exception:  # aiortc validates little of its input
        raise InvalidRequest(NO_SDP) from None
    if not bundled:
        raise InvalidRequest("The offer must have its video and its data on one transport (BUNDLE).")


def _check_offer(offer: SessionDescription) -> None:
    """Check fields that aiortc reads only once the viewer connects, or never. Raises InvalidRequest."""
    for media in offer.media:
        fingerprints = media.dtls.fingerprints if media.dtls is not None else ()
        if not any(each.algorithm.lower() in X509_DIGEST_ALGORITHMS for each in fingerprints):
            raise InvalidRequest("The offer must have a fingerprint (sha-256, sha-384 or sha-512) for each transport.")
        if media.kind == "application":
            if media.sctp_port is None or not 0 < media.sctp_port < 65536:
                raise InvalidRequest("The offer's data transport must have an SCTP port from 1 to 65535.")
            takes = media.sctpCapabilities
            if takes is not None and takes.maxMessageSize < MIN_MESSAGE_SIZE and takes.maxMessageSize != UNLIMITED:
                raise InvalidRequest(f"The offer's data transport must accept messages of {MIN_MESSAGE_SIZE} bytes.")


async def create_answer(connection: RTCPeerConnection, track: MediaStreamTrack, candidate: str) -> tuple[str, str]:
    """Answer the accepted offer. Returns the SDP with this candidate, and the codec's name. Raises InvalidRequest."""
    (video,) = connection.getTransceivers()
    connection.addTrack(track)
    video.direction = "sendonly"
    try:
        await connection.setLocalDescription(await connection.createAnswer())
    except Exception:  # as in `_set_offer`
        raise InvalidRequest(NO_SDP) from None
    codec = _CODEC.search(connection.localDescription.sdp)
    if video.currentDirection != "sendonly" or codec is None:
        raise InvalidRequest("The offer does not request video.")
    sdp = re.sub("a=candidate:.*", f"a=candidate:{candidate}\r", connection.localDescription.sdp)
    return sdp, codec[1]
