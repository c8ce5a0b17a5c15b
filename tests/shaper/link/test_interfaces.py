"""Names of interfaces, which become words of commands."""

from __future__ import annotations

import pytest

from tigas_shaper.link.interfaces import Interface


@pytest.mark.parametrize("name", ["", "a b", "eth0;reboot", "-h", "x\ny", "a/b", "a" * 16, '"', "é"])
def test_what_is_no_interfaces_name_is_refused(name: str) -> None:
    with pytest.raises(ValueError, match="is not the name of a network interface"):
        Interface(name)


def test_an_interfaces_number_tells_whether_it_exists() -> None:
    assert Interface("lo").number
    assert Interface("nope0").number is None
