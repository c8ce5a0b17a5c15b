"""The shaper's interfaces, as its settings name them."""

from __future__ import annotations

import json
import subprocess

import pytest

from tigas_common.errors import StartError
from tigas_shaper.main import find_interface


@pytest.fixture(autouse=True)
def addresses(monkeypatch: pytest.MonkeyPatch) -> None:
    found = [{"ifname": "lo", "addr_info": [{"local": "127.0.0.1"}]}, {"ifname": "eth1"}]
    found.append({"ifname": "eth2", "addr_info": [{"local": "172.30.2.5"}]})
    answer = subprocess.CompletedProcess((), 0, stdout=json.dumps(found))
    monkeypatch.setattr("tigas_shaper.main.subprocess.run", lambda *_, **__: answer)


@pytest.mark.parametrize("text", ["172.30.2.0/24", "172.30.2.5/24", "172.30.2.9/24", "172.30.2.5"])
def test_an_interface_is_found_by_any_address_of_its_network(text: str) -> None:
    assert find_interface(text) == "eth2"


def test_a_network_without_an_interface_is_named() -> None:
    with pytest.raises(StartError, match=r"^No network interface has an address in 10\.1\.2\.0/24\.$"):
        find_interface("10.1.2.3/24")
