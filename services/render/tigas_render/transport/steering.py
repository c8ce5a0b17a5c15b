"""Makes the kernel deliver each datagram to the socket of its edge, by a classic BPF program (bpf(4), socket(7)).

The sockets of a port (SO_REUSEPORT) are numbered in the order of binding. Without a program the kernel chooses one by
the addresses, so that a client with a changed address reaches another edge.
"""

from __future__ import annotations

import ctypes
import socket
import struct

from tigas_render.transport.cids import LONG_HEADER_CID, SHORT_HEADER_CID

SO_ATTACH_REUSEPORT_CBPF = 51
LOAD_BYTE, JUMP, JUMP_IF_SET, MODULO, RETURN = 0x30, 0x05, 0x45, 0x94, 0x16
LONG_HEADER = 0x80


def steer(sock: socket.socket, edges: int) -> bool:
    """Steer all sockets of this one's port from now on; whether the kernel does that."""
    program = b"".join(
        struct.pack("@HBBI", *instruction)
        for instruction in (
            (LOAD_BYTE, 0, 0, 0),
            (JUMP_IF_SET, 0, 2, LONG_HEADER),
            (LOAD_BYTE, 0, 0, LONG_HEADER_CID),
            (JUMP, 0, 0, 1),
            (LOAD_BYTE, 0, 0, SHORT_HEADER_CID),
            (MODULO, 0, 0, edges),
            (RETURN, 0, 0, 0),
        )
    )
    buffer = ctypes.create_string_buffer(program, len(program))
    try:
        sock.setsockopt(
            socket.SOL_SOCKET,
            SO_ATTACH_REUSEPORT_CBPF,
            struct.pack("@HP", len(program) // 8, ctypes.addressof(buffer)),
        )
    except OSError:
        return False
    return True
