"""Congestion control that does not take silence for success.

A frame server is idle between frames. aioquic's controllers grow the window with every acknowledgement even when the
window was never full, so after a minute of small frames it is meaningless, and the first large frame leaves as one
burst that a 5 Mbit/s link drops. RFC 9002, 7.8: a window that is not used does not grow.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from typing import Any, Literal

from aioquic.quic.congestion.base import QuicCongestionControl, register_congestion_control
from aioquic.quic.congestion.cubic import CubicCongestionControl
from aioquic.quic.congestion.reno import RenoCongestionControl
from aioquic.quic.packet_builder import QuicSentPacket

CongestionControl = Literal["reno", "cubic"]


class WindowLimited(QuicCongestionControl):
    """Lets the window of the controller that it is mixed with grow only for packets sent while it was full."""

    def __init__(self, *, max_datagram_size: int) -> None:
        super().__init__(max_datagram_size=max_datagram_size)
        self._packet_size = max_datagram_size
        self._full_at = -1  # number of the last packet that left no room for another

    def on_packet_sent(self, *, packet: QuicSentPacket) -> None:
        """Remember whether the window is full."""
        super().on_packet_sent(packet=packet)  # type: ignore[safe-super]  # the mixed-in controller's
        if self.bytes_in_flight + self._packet_size > self.congestion_window:
            self._full_at = packet.packet_number

    def on_packet_acked(self, *, now: float, packet: QuicSentPacket) -> None:
        """Undo the growth for a packet that did not need it."""
        window = self.congestion_window
        super().on_packet_acked(now=now, packet=packet)  # type: ignore[safe-super]
        if packet.packet_number > self._full_at:
            self.congestion_window = min(self.congestion_window, window)

    def on_packets_sent(self, packets: Sequence[QuicSentPacket]) -> None:
        """As `on_packet_sent` for each of them, the oldest first."""
        for packet in packets:
            self.on_packet_sent(packet=packet)

    def on_packets_acked(self, packets: Sequence[QuicSentPacket], now: float) -> None:
        """As `on_packet_acked` for each of them, the oldest first."""
        for packet in packets:
            self.on_packet_acked(now=now, packet=packet)


class LimitedReno(WindowLimited, RenoCongestionControl):
    """NewReno (RFC 9002), which takes a batch at once."""

    def on_packets_sent(self, packets: Sequence[QuicSentPacket]) -> None:
        """As `on_packet_sent` for each of them: once the window is full, it is full for those that follow."""
        self.bytes_in_flight += sum(packet.sent_bytes for packet in packets)
        if self.bytes_in_flight + self._packet_size > self.congestion_window:
            self._full_at = packets[-1].packet_number

    def on_packets_acked(self, packets: Sequence[QuicSentPacket], now: float) -> None:
        """As `on_packet_acked` for each of them: those sent with room to spare change nothing but what is in flight."""
        first_spare = bisect_right(packets, self._full_at, key=_number)
        for packet in packets[:first_spare]:
            self.on_packet_acked(now=now, packet=packet)
        self.bytes_in_flight -= sum(packet.sent_bytes for packet in packets[first_spare:])


class LimitedCubic(WindowLimited, CubicCongestionControl):
    """CUBIC (RFC 9438)."""


def _number(packet: QuicSentPacket) -> int:
    return packet.packet_number


def algorithm(name: CongestionControl) -> str:
    """What aioquic's configuration calls the controller. Raises ValueError for an unknown name."""
    try:
        return _ALGORITHMS[name]
    except KeyError:
        raise ValueError(f"Congestion control is one of {', '.join(_ALGORITHMS)}, not {name!r}.") from None


def _register(name: str, controller: Any) -> str:
    register_congestion_control(f"tigas-{name}", controller)
    return f"tigas-{name}"


_ALGORITHMS: dict[str, str] = {"reno": _register("reno", LimitedReno), "cubic": _register("cubic", LimitedCubic)}
