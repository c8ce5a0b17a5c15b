"""All uses of aioquic's private names: batches of packets, bounded memory, and timers for a busy event loop.

`tigas_common.installation` refuses versions other than the one these modules were written for.
"""
