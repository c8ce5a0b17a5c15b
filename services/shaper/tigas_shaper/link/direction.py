"""One direction of the link as lines for tc: where packets leave their way, are held to a rate, and come back.

    forwarded packets, marked by nftables
      → clsact egress of the interface towards their receiver: redirected to the rate device
      → HTB on the rate device, whose leaf is a queue counted in bytes
      → delay, jitter and loss (delay.py)
      → the interface, and out

Only marked packets take this way: what the gateway itself sends, such as answers of its API, is not shaped.
The leaf is a token bucket far faster than the link. It queues bytes in first-in-first-out order as bfifo does, and in
addition it cuts segmentation-offload super-packets (up to 64 kB, one unit to a queue) into packets as they arrive, so
a sender that we cannot reach may keep its offloads.
"""

from __future__ import annotations

from dataclasses import dataclass

from tigas_shaper.link.interfaces import Interface

MARK = 0x7469
"""The mark of packets that cross the link."""
FLOOR_KBPS = 50.0
"""The least rate. HTB waits out a packet's time before it sends the next, even after the rate has risen: at this rate
a quarter of a second. In an outage, HTB keeps its rate and the leaf is slowed to this one instead, since a token bucket
forgets its debt when it is changed: traffic flows again at once. What still trickles through, the delay stage stops."""
FULL_PACKET = 1514
"""Bytes of a full Ethernet packet, as tc counts it."""
MIN_QUEUE = 8 * FULL_PACKET
"""A queue never holds less, in bytes: a slow link must still take a burst of a few packets."""
LEAF_KBPS = 1e7
LEAF_BURST = 2 * FULL_PACKET
# Classic BPF, instructions as "code jump-true jump-false operand"; the mark is at SKF_AD_OFF + SKF_AD_MARK.
_IS_MARKED = f"4,32 0 0 4294963220,21 0 1 {MARK},6 0 0 4294967295,6 0 0 0"
_EVERYTHING = "1,6 0 0 4294967295"


def queue_bytes(rate_kbps: float, queue_ms: float) -> int:
    """The length of a queue that takes `queue_ms` to drain at a rate."""
    return max(MIN_QUEUE, round(rate_kbps * queue_ms / 8))


@dataclass(frozen=True, slots=True)
class Direction:
    """One direction: its rate device, and the interface towards its receivers. Methods return lines for `tc -batch`."""

    device: Interface
    interface: Interface

    def rate_lines(self, rate_kbps: float) -> list[str]:
        """The rate device's queueing, with a queue of the least length; the device must exist and be up."""
        return [
            f"qdisc add dev {self.device} root handle 1: htb default 1",
            self._class("add", rate_kbps),
            self._leaf("add", MIN_QUEUE, LEAF_KBPS),
        ]

    def redirect_lines(self) -> list[str]:
        """Send marked packets that leave the interface to the rate device."""
        return [
            f"qdisc add dev {self.interface} clsact",
            f"filter add dev {self.interface} egress protocol ip prio 1 bpf bytecode {quoted(_IS_MARKED)} "
            f"action mirred egress redirect dev {self.device}",
        ]

    def return_lines(self) -> list[str]:
        """Send packets that come out of the rate device's far end, a TAP device's reader, out of the interface."""
        return [
            f"qdisc add dev {self.device} clsact",
            f"filter add dev {self.device} ingress protocol ip prio 1 bpf bytecode {quoted(_EVERYTHING)} "
            f"action mirred egress redirect dev {self.interface}",
        ]

    def netem_lines(self) -> list[str]:
        """Put a netem leaf in the way of marked packets on the interface; all others pass it by, unqueued."""
        return [
            f"qdisc add dev {self.interface} root handle 2: htb default 0",
            f"class add dev {self.interface} parent 2: classid 2:1 htb rate 100gbit burst 1mb cburst 1mb quantum 3028",
            f"qdisc add dev {self.interface} parent 2:1 handle 20: netem limit 100000",
            f"filter add dev {self.interface} parent 2: protocol ip prio 1 "
            f"bpf bytecode {quoted(_IS_MARKED)} flowid 2:1",
        ]

    def change_rate_line(self, rate_kbps: float) -> str:
        """Change the rate; queued packets stay."""
        return self._class("change", rate_kbps)

    def change_queue_line(self, limit_bytes: int, *, blocked: bool) -> str:
        """Change the queue's length, and whether packets leave it."""
        return self._leaf("change", limit_bytes, FLOOR_KBPS if blocked else LEAF_KBPS)

    def change_netem_line(self, delay_ms: float, jitter_ms: float, loss_pct: float) -> str:
        """Change delay, jitter and loss of the netem leaf.

        A rate, however high, makes netem send packets in the order in which they came, in spite of jitter.
        """
        return (
            f"qdisc change dev {self.interface} parent 2:1 handle 20: netem limit 100000 "
            f"delay {_us(delay_ms)}us {_us(jitter_ms)}us loss {loss_pct:.4f}% rate 100gbit"
        )

    def _class(self, verb: str, rate_kbps: float) -> str:
        rate = max(rate_kbps, FLOOR_KBPS)
        # A timer that fires a little late may catch up; at most a millisecond of the rate goes at once.
        burst = max(2 * FULL_PACKET, round(rate / 8))
        return (
            f"class {verb} dev {self.device} parent 1: classid 1:1 htb "
            f"rate {round(rate * 1000)}bit burst {burst}b cburst {burst}b quantum {2 * FULL_PACKET}"
        )

    def _leaf(self, verb: str, limit_bytes: int, rate_kbps: float) -> str:
        return (
            f"qdisc {verb} dev {self.device} parent 1:1 handle 10: "
            f"tbf rate {round(rate_kbps)}kbit burst {LEAF_BURST}b limit {limit_bytes}b"
        )


def quoted(text: str) -> str:
    """One word for tc, which splits its lines at blanks outside quotes."""
    return f'"{text}"'


def _us(milliseconds: float) -> int:
    return round(milliseconds * 1000)
