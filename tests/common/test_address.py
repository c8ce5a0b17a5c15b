"""The warning about a service open to the network."""

from __future__ import annotations

import pytest

from tigas_common.address import ISOLATED, Address, say_if_open

HOME, EVERYWHERE = Address("127.0.0.1", 80), Address("0.0.0.0", 80)


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
    monkeypatch.delenv(ISOLATED, raising=False)
    if isolated:
        monkeypatch.setenv(ISOLATED, "yes")
    say_if_open(addresses)
    printed = capsys.readouterr().out
    assert printed.startswith(said)
    assert bool(printed) == bool(said)
