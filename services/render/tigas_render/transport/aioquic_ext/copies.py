"""Second copies of a frame's packets on a path that loses packets at random.

A lost packet delays its frame by a round trip. While the path has no queue, every packet is therefore sent a second
time, after all other data. Copies leave at the same rate as their originals, and stop at the first sign of a queue.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

from tigas_render.transport.aioquic_ext.congestion import TickPacer
from tigas_render.transport.aioquic_ext.recovery import BatchRecovery, StreamPacket

MAX_WAITING = 256
"""Maximum number of packets waiting to be copied; older ones are dropped."""


class CopyQueue:
    """The packets in flight that are worth a second copy."""

    def __init__(self, loss: BatchRecovery, pacer: TickPacer) -> None:
        """pacer: the pacer of the originals."""
        self._loss = loss
        self._originals = pacer
        self._pacer = TickPacer(max_datagram_size=pacer._max_datagram_size)
        self._waiting: deque[StreamPacket] = deque(maxlen=MAX_WAITING)

    def __bool__(self) -> bool:
        return bool(self._waiting)

    def add(self, packets: Iterable[StreamPacket], now: float) -> None:
        """Add packets that are being sent now."""
        if self._loss.should_duplicate(now):
            self._waiting.extend(packets)

    def pop_due(self, now: float) -> list[StreamPacket]:
        """Return the packets to send a second time now."""
        if not self._loss.should_duplicate(now):
            self._waiting.clear()
        waiting, pacer, pace = self._waiting, self._pacer, self._originals
        pacer.packet_time, pacer.bucket_max = pace.packet_time, pace.bucket_max
        allowed = pacer.allowance(now, len(waiting))
        taken: list[StreamPacket] = []
        while waiting and len(taken) < allowed:
            packet = waiting.popleft()
            fits = packet.sent_bytes <= pace._max_datagram_size
            if fits and now - packet.sent_time < self._loss._rtt_smoothed and packet.is_outstanding:
                taken.append(packet)
        pacer.update_after_sends(len(taken))
        return taken

    def next_send_time(self, now: float) -> float | None:
        """When to send the next copies; None if no packets are waiting."""
        return self._pacer.next_burst(now, len(self._waiting)) if self._waiting else None
