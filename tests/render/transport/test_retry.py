"""Retry tokens prove an address, for a short while, for one connection id."""

from __future__ import annotations

from tigas_render.transport.retry import TOKEN_LIFETIME, RetryTokens

ADDRESS = ("192.0.2.1", 4433)


def test_a_token_is_for_one_address_one_id_and_a_while() -> None:
    tokens = RetryTokens()
    token = tokens.create(ADDRESS, b"original", b"retry", now=100.0)
    assert tokens.validate(token, ADDRESS, b"retry", now=100.0 + TOKEN_LIFETIME) == b"original"
    assert tokens.validate(token, ADDRESS, b"retry", now=100.1 + TOKEN_LIFETIME) is None
    assert tokens.validate(token, ("192.0.2.2", 4433), b"retry", now=100.0) is None
    assert tokens.validate(token, ("192.0.2.1", 4434), b"retry", now=100.0) is None
    assert tokens.validate(token, ADDRESS, b"other", now=100.0) is None


def test_forged_tokens_are_refused() -> None:
    tokens = RetryTokens()
    token = tokens.create(ADDRESS, b"original", b"retry", now=100.0)
    for forged in (b"", b"short", token[:-1], token[:-1] + bytes([token[-1] ^ 1]), bytes(len(token))):
        assert tokens.validate(forged, ADDRESS, b"retry", now=100.0) is None
    assert RetryTokens().validate(token, ADDRESS, b"retry", now=100.0) is None
