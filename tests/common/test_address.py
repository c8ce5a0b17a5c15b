"""Addresses: where services listen, from where they can be reached, and the hosts that requests name and come from."""

from __future__ import annotations

import pytest

from tigas_common.address import (
    ISOLATED_VARIABLE,
    Address,
    client_network,
    is_address,
    is_loopback,
    is_network_name,
    parse_host,
    parse_origin_host,
    warn_if_open,
)

HOME, EVERYWHERE = Address("127.0.0.1", 80), Address("0.0.0.0", 80)


@pytest.mark.parametrize(
    ("text", "address"),
    [
        ("127.0.0.1:8080", Address("127.0.0.1", 8080)),
        ("[::]:4433", Address("::", 4433)),
        ("localhost:0", Address("localhost", 0)),
    ],
)
def test_addresses_are_read_and_written_alike(text: str, address: Address) -> None:
    assert Address.parse(text) == address
    assert str(address) == text


@pytest.mark.parametrize(
    "text", ["", "8080", "host:", "host:port", "host:70000", "host:-1", ":8080", "host:٣", "host:" + "9" * 5000]
)
def test_a_wrong_address_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"HOST:PORT|no host"):
        Address.parse(text)


@pytest.mark.parametrize(
    ("addresses", "isolated", "said"),
    [
        ((HOME,), False, ""),
        ((HOME, EVERYWHERE), False, "Open to the network on 0.0.0.0:80: any machine that reaches this one"),
        ((EVERYWHERE,), True, ""),
    ],
)
def test_a_service_says_if_others_reach_it(
    addresses: tuple[Address, ...],
    isolated: bool,
    said: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.delenv(ISOLATED_VARIABLE, raising=False)
    if isolated:
        monkeypatch.setenv(ISOLATED_VARIABLE, "yes")
    warn_if_open(addresses)
    printed = capsys.readouterr().out
    assert printed.startswith(said)
    assert bool(printed) == bool(said)


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
    assert parse_host(text) == host
    assert parse_origin_host(f"http://{text}") == host


def test_an_origin_is_a_web_pages() -> None:
    assert parse_origin_host("https://tigas.example:8443") == "tigas.example"
    for text in ("null", "", "localhost", "file://", "chrome-extension://abcdef", "https://a.example/page"):
        assert parse_origin_host(text) is None


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


@pytest.mark.parametrize(
    ("host", "network"),
    [
        ("192.0.2.7", "192.0.2.7"),
        ("127.0.0.1", "127.0.0.1"),
        ("::ffff:192.0.2.7", "192.0.2.7"),
        ("2001:db8:1:2:aaaa::1", "2001:db8:1:2::/64"),
        ("2001:db8:1:2:bbbb::9", "2001:db8:1:2::/64"),
        ("2001:db8:1:3::1", "2001:db8:1:3::/64"),
        ("fe80::1%eth0", "fe80::/64"),
        ("::1", "::/64"),
        ("unknown", "unknown"),
    ],
)
def test_whom_an_address_counts_with(host: str, network: str) -> None:
    assert client_network(host) == network
