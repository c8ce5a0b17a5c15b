"""Stateless resets (RFC 9000, 10.3): a restarted server tells its earlier clients that their connections are lost.

Without one, a client keeps sending until its idle timeout.
"""

from __future__ import annotations

import hashlib
import hmac
import os

TOKEN_LENGTH = 16
MIN_LENGTH = 5 + TOKEN_LENGTH
"""Bytes of the shortest reset: it looks like a packet with a short header."""
MAX_LENGTH = 43
"""Maximum length; more has no benefit."""
MAX_PER_SECOND = 100


class StatelessResets:
    """Makes tokens and resets. The tokens are derived from the key, the port and the connection id, without state.

    The port is included so that two servers with one key cannot end each other's connections.
    """

    def __init__(self, key: bytes, port: int) -> None:
        self._key = hashlib.sha256(key + port.to_bytes(2, "big")).digest()
        self._second = 0
        self._sent = 0

    def token(self, cid: bytes) -> bytes:
        """Proof that a reset of the connection with this id comes from the server."""
        return hmac.digest(self._key, cid, "sha256")[:TOKEN_LENGTH]

    def answer(self, size: int, cid: bytes, now: float) -> bytes | None:
        """The reset that answers a packet of `size` bytes for an unknown connection; None if there have been too many.

        It is shorter than that packet, so that two endpoints that do not know each other fall silent.
        """
        length = min(size - 1, MAX_LENGTH)
        if length < MIN_LENGTH:
            return None
        if int(now) != self._second:
            self._second, self._sent = int(now), 0
        if self._sent >= MAX_PER_SECOND:
            return None
        self._sent += 1
        filling = bytearray(os.urandom(length - TOKEN_LENGTH))
        filling[0] = 0x40 | filling[0] & 0x3F
        return bytes(filling) + self.token(cid)
