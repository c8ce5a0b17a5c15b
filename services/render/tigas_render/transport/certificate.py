"""The server's self-signed certificate, which is short-lived, created in memory at start, and trusted by its hash.

A browser accepts it for WebTransport through `serverCertificateHashes`, which requires ECDSA P-256 and a validity of
at most 14 days, so neither a browser flag nor an installed CA is needed.
"""

from __future__ import annotations

import base64
import contextlib
import hashlib
import ipaddress
import ssl
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

VALIDITY = timedelta(days=13)
"""Time from not-before to not-after."""
CLOCK_SKEW = timedelta(hours=1)
"""A certificate becomes valid this long before its creation, for clients with a slow clock."""
RENEW_BEFORE = timedelta(days=3)
"""A certificate with less time left than this must be replaced."""
LOOPBACK_NAMES = ("localhost", "127.0.0.1", "::1")


@dataclass(frozen=True, slots=True)
class Certificate:
    """A self-signed certificate and its private key."""

    x509: x509.Certificate
    private_key: ec.EllipticCurvePrivateKey

    @classmethod
    def create(cls, names: Iterable[str], now: datetime) -> Certificate:
        """Create a certificate for loopback and the given host names and IP addresses, valid for 13 days around `now`.

        `now` must be timezone-aware. Raises ValueError for a name that is neither a host name nor an IP address.
        """
        key = ec.generate_private_key(ec.SECP256R1())
        subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "TIGAS")])
        start = now - CLOCK_SKEW
        alternatives = dict.fromkeys(map(_general_name, (*LOOPBACK_NAMES, *names)))
        certificate = (
            x509.CertificateBuilder()
            .subject_name(subject)
            .issuer_name(subject)
            .public_key(key.public_key())
            .serial_number(x509.random_serial_number())
            .not_valid_before(start)
            .not_valid_after(start + VALIDITY)
            .add_extension(x509.SubjectAlternativeName(alternatives), critical=False)
            .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
            .add_extension(x509.ExtendedKeyUsage([ExtendedKeyUsageOID.SERVER_AUTH]), critical=False)
            .sign(key, hashes.SHA256())
        )
        return cls(certificate, key)

    @property
    def pem(self) -> bytes:
        """The certificate in PEM format, without its key."""
        return self.x509.public_bytes(serialization.Encoding.PEM)

    @property
    def pem_with_key(self) -> bytes:
        """Private key and certificate in PEM format, the input of `from_pem_with_key`."""
        key = self.private_key.private_bytes(
            serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
        )
        return key + self.pem

    @classmethod
    def from_pem_with_key(cls, pem: bytes) -> Certificate:
        """Load a certificate that another process created, from the PEM of `pem_with_key`."""
        key = serialization.load_pem_private_key(pem, None)
        assert isinstance(key, ec.EllipticCurvePrivateKey)
        return cls(x509.load_pem_x509_certificate(pem), key)

    @property
    def sha256(self) -> str:
        """Base64 of the SHA-256 of the DER form, as announced to the page in `/config.json`."""
        return base64.b64encode(self.x509.fingerprint(hashes.SHA256())).decode()

    @property
    def public_key_sha256(self) -> str:
        """Base64 of the SHA-256 of the public key (SPKI)."""
        key = self.x509.public_key().public_bytes(
            serialization.Encoding.DER, serialization.PublicFormat.SubjectPublicKeyInfo
        )
        return base64.b64encode(hashlib.sha256(key).digest()).decode()

    @property
    def not_after(self) -> datetime:
        """Expiry time in UTC."""
        return self.x509.not_valid_after_utc

    def needs_renewal(self, now: datetime) -> bool:
        """Whether to replace it, because it expires soon or because the clock was ahead when it was created."""
        return not self.x509.not_valid_before_utc <= now < self.not_after - RENEW_BEFORE

    def load_into(self, context: ssl.SSLContext) -> None:
        """Load this certificate into a TLS server's context.

        Python's ssl module reads keys only from files, so the key is written to a private temporary directory first.
        """
        with tempfile.TemporaryDirectory(prefix="tigas-") as directory:  # made with mode 0700
            path = Path(directory) / "certificate.pem"
            path.write_bytes(self.pem_with_key)
            context.load_cert_chain(path)


def _general_name(name: str) -> x509.GeneralName:
    with contextlib.suppress(ValueError):
        return x509.IPAddress(ipaddress.ip_address(name.strip("[]").partition("%")[0]))
    try:
        ascii_name = name.encode("idna").decode()
    except UnicodeError:
        ascii_name = ""
    if not ascii_name or any(c in ascii_name for c in " /:@\0"):
        raise ValueError(f"{name!r} is neither a host name nor an IP address.")
    return x509.DNSName(ascii_name)
