"""Browsers accept the certificate by its hash, and TLS servers can use it."""

from __future__ import annotations

import base64
import hashlib
import ipaddress
import socket
import ssl
import tempfile
import threading
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import Encoding, PublicFormat

from tigas_render.transport.certificate import Certificate

NOW = datetime(2030, 1, 15, 12, tzinfo=UTC)


def names_of(certificate: Certificate) -> x509.SubjectAlternativeName:
    return certificate.x509.extensions.get_extension_for_class(x509.SubjectAlternativeName).value


def test_browsers_accept_it_by_hash() -> None:
    certificate = Certificate.create([], NOW)
    public_key = certificate.x509.public_key()
    assert isinstance(public_key, ec.EllipticCurvePublicKey)
    assert isinstance(public_key.curve, ec.SECP256R1)
    assert certificate.x509.not_valid_before_utc < NOW, "a client's clock may be behind"
    assert certificate.not_after - certificate.x509.not_valid_before_utc <= timedelta(days=13)
    assert base64.b64decode(certificate.sha256) == hashlib.sha256(certificate.x509.public_bytes(Encoding.DER)).digest()
    key = public_key.public_bytes(Encoding.DER, PublicFormat.SubjectPublicKeyInfo)
    assert base64.b64decode(certificate.public_key_sha256) == hashlib.sha256(key).digest()


def test_every_certificate_has_its_own_key() -> None:
    assert Certificate.create([], NOW).sha256 != Certificate.create([], NOW).sha256


def test_names_cover_loopback_and_what_was_asked_for() -> None:
    names = names_of(
        Certificate.create(["lab.example", "192.0.2.7", "[2001:db8::7]", "fe80::1%eth0", "münchen.example"], NOW)
    )
    assert names.get_values_for_type(x509.DNSName) == ["localhost", "lab.example", "xn--mnchen-3ya.example"]
    assert names.get_values_for_type(x509.IPAddress) == [
        ipaddress.ip_address(a) for a in ("127.0.0.1", "::1", "192.0.2.7", "2001:db8::7", "fe80::1")
    ]


@pytest.mark.parametrize("name", ["", "two words", "https://lab.example", "a..b", "x" * 300])
def test_a_name_that_is_none_is_refused(name: str) -> None:
    with pytest.raises(ValueError, match="neither a host name nor an IP address"):
        Certificate.create([name], NOW)


def test_renewal_comes_before_expiry() -> None:
    certificate = Certificate.create([], NOW)
    assert not certificate.needs_renewal(NOW + timedelta(days=9))
    assert certificate.needs_renewal(NOW + timedelta(days=10))
    assert certificate.needs_renewal(certificate.not_after)


def test_one_made_while_the_clock_was_ahead_is_renewed_once_it_is_right() -> None:
    ahead = Certificate.create([], NOW + timedelta(days=2))
    assert ahead.needs_renewal(NOW)
    assert not Certificate.create([], NOW).needs_renewal(NOW)


def test_a_tls_server_serves_it_and_no_key_stays_on_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    certificate = Certificate.create([], datetime.now(UTC))
    server_context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    certificate.load_into(server_context)
    assert list(tmp_path.iterdir()) == []

    client_context = ssl.create_default_context(cadata=certificate.pem.decode())
    left, right = socket.socketpair()

    def serve() -> None:
        with server_context.wrap_socket(left, server_side=True) as connection:
            connection.sendall(b"hello")

    thread = threading.Thread(target=serve)
    thread.start()
    with client_context.wrap_socket(right, server_hostname="localhost") as connection:
        assert connection.recv(5) == b"hello"
        assert connection.getpeercert(binary_form=True) == certificate.x509.public_bytes(Encoding.DER)
    thread.join()
