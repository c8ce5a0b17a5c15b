"""Tokens for Retry packets (RFC 9000, 8.1.2): proof that a client receives at the address that it sends from.

A server that a flood of first packets keeps busy asks for one before it spends memory on a handshake.
"""

from __future__ import annotations

import os
import struct

from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives.ciphers.aead import AESGCM

from tigas_render.transport.gso import Address

TOKEN_LIFETIME = 10.0
"""Seconds for a client to return."""
RETRY_ID_LENGTH = 8
KEY_LENGTH = 16
NONCE_LENGTH = 12


class RetryTokens:
    """Makes and checks tokens; stateless. Servers with the same key accept each other's."""

    def __init__(self, key: bytes | None = None) -> None:
        """key: of KEY_LENGTH bytes; a new one by default."""
        self._aead = AESGCM(key or os.urandom(KEY_LENGTH))

    def new_connection_id(self) -> bytes:
        """The connection id that the client must use when it comes back."""
        return os.urandom(RETRY_ID_LENGTH)

    def create(self, address: Address, original_cid: bytes, retry_cid: bytes, now: float) -> bytes:
        """A token for one client's next first packet."""
        nonce = os.urandom(NONCE_LENGTH)
        return nonce + self._aead.encrypt(nonce, struct.pack("!d", now) + original_cid, _bound(address, retry_cid))

    def validate(self, token: bytes, address: Address, retry_cid: bytes, now: float) -> bytes | None:
        """The connection id that the client chose at first, or None if the token is not for it or too old."""
        try:
            content = self._aead.decrypt(token[:NONCE_LENGTH], token[NONCE_LENGTH:], _bound(address, retry_cid))
        except (InvalidTag, ValueError):
            return None
        (made,) = struct.unpack_from("!d", content)
        return content[8:] if 0 <= now - made <= TOKEN_LIFETIME else None


def _bound(address: Address, retry_cid: bytes) -> bytes:
    return repr(address[:2]).encode() + b"|" + retry_cid
