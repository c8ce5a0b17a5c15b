"""The mark of packets that cross the link, and the tc filters that match it."""

from __future__ import annotations

MARK = 0x7469
"""Set by the gateway on forwarded packets."""
# Classic BPF, instructions as "code jump-true jump-false operand"; the mark is at SKF_AD_OFF + SKF_AD_MARK. One word
# for tc, which splits its lines at blanks outside quotes.
MARKED = f'bpf bytecode "4,32 0 0 4294963220,21 0 1 {MARK},6 0 0 4294967295,6 0 0 0"'
EVERYTHING = 'bpf bytecode "1,6 0 0 4294967295"'
