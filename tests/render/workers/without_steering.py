"""The `tigas` command on a machine with a kernel that delivers datagrams to any edge. Run by the tests."""

from __future__ import annotations

import socket
from unittest.mock import patch

from tigas_common import cli


def steer(sock: socket.socket, edges: int) -> bool:
    return False


if __name__ == "__main__":
    with patch("tigas_render.server.public_sockets.steer", steer):
        cli.main()
