"""The `tigas` command on a machine whose kernel brings datagrams to any edge. Run by the tests."""

from __future__ import annotations

import socket
from unittest.mock import patch

from tigas_common import cli


def steer(sock: socket.socket, edges: int) -> bool:
    return False


if __name__ == "__main__":
    with patch("tigas_render.fleet.sockets.steer", steer):
        cli.main()
