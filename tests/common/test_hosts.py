"""The name in a Host or an Origin."""

from __future__ import annotations

import pytest

from tigas_common.hosts import host_of, host_of_origin, is_address, is_loopback, is_network_name


@pytest.mark.parametrize(
    ("text", "host"),
    [
        ("localhost:8080", "localhost"),
        ("LocalHost", "localhost"),
        ("localhost.:8080", "localhost"),
        ("10.0.0.1", "10.0.0.1"),
        ("[::1]:4433", "::1"),
        ("tigas_render_1:8080", "tigas_render_1"),
        ("", None),
        ("localhost:80:80", None),
        ("evil.example@localhost", None),
        ("localhost/evil", None),
        ("localhost; script-src *", None),
        ("localhost\n", None),
        ("löcalhost", None),
        ("[::1", None),
    ],
)
def test_a_host_is_a_name_or_an_address_and_nothing_else(text: str, host: str | None) -> None:
    assert host_of(text) == host
    assert host_of_origin(f"http://{text}") == host


def test_an_origin_is_a_web_pages() -> None:
    assert host_of_origin("https://tigas.example:8443") == "tigas.example"
    for text in ("null", "", "localhost", "file://", "chrome-extension://abcdef", "https://a.example/page"):
        assert host_of_origin(text) is None


@pytest.mark.parametrize(
    ("host", "address", "loopback", "network"),
    [
        ("localhost", False, True, True),
        ("tigas.localhost", False, True, False),
        ("127.0.0.1", True, True, False),
        ("127.9.9.9", True, True, False),
        ("::1", True, True, True),
        ("192.168.1.5", True, False, False),
        ("fe80::1", True, False, True),
        ("render", False, False, True),
        ("lab.local", False, False, True),
        ("evil.example", False, False, False),
        ("localhost.evil.example", False, False, False),
        ("127.0.0.1.nip.io", False, False, False),
    ],
)
def test_kinds_of_hosts(host: str, address: bool, loopback: bool, network: bool) -> None:
    assert (is_address(host), is_loopback(host)) == (address, loopback)
    if not address:
        assert is_network_name(host) is network
