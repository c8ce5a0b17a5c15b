"""All code that uses aioquic's private names: batches of packets, bounded memory, and timers for a busy event loop.

`tigas_common.installation` refuses versions of aioquic other than the one that these modules were written for.
"""
