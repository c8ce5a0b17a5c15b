"""Forwarded ports, and the table that forwards them."""

from __future__ import annotations

import pytest

from tigas_shaper.link.commands import Interface
from tigas_shaper.link.gateway import Forward, rules


def test_a_forward_reads_its_protocol_ports_and_host() -> None:
    forward = Forward.parse("udp:4433=192.0.2.7:443")
    assert (forward.protocol, forward.port, str(forward.host), forward.host_port) == ("udp", 4433, "192.0.2.7", 443)
    assert str(Forward.parse("tcp:80=localhost:8080").host) == "127.0.0.1"


@pytest.mark.parametrize(
    "text",
    ["", "8080", "tcp:8080", "sctp:1=a:2", "tcp:0=a:1", "tcp:1=a:65536", "tcp:x=a:1", "tcp:²=a:1", "tcp:1=:2",
     "tcp:1=a b; drop:2", "udp:1=nowhere.invalid:2"],
)  # fmt: skip
def test_what_is_no_forward_is_refused_with_a_sentence(text: str) -> None:
    with pytest.raises(ValueError, match=r"is not tcp:PORT=HOST:PORT|has no IPv4 address"):
        Forward.parse(text)


def test_the_gate_is_closed_first_and_only_forwarded_packets_pass() -> None:
    lines = rules(Interface("a0"), Interface("s0"), [Forward.parse("tcp:80=192.0.2.1:8080")])
    assert lines[0].endswith("{ flags owner; }")
    assert lines.index("add rule ip tigas_shaper gate drop") < min(
        index for index, line in enumerate(lines) if "hook" in line
    )
    crossing = [line for line in lines if " crossing " in line and "add rule" in line]
    assert [line[-9:] for line in crossing[:2]] == ["jump gate"] * 2
    assert all("ct status dnat" in line for line in crossing if "accept" in line)
    assert [line[-4:] for line in crossing[-2:]] == ["drop", "drop"]
