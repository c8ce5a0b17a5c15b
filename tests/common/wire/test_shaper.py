"""Messages of the shaper: strict bounds."""

from __future__ import annotations

import math

import pytest
from pydantic import ValidationError

from tigas_common.parsing import parse
from tigas_common.wire.shaper import LinkSetting


@pytest.mark.parametrize("bad", [-1.0, math.nan, math.inf, -math.inf, 1.1e8])
@pytest.mark.parametrize("field", ["down_kbps", "up_kbps"])
def test_a_rate_that_no_link_has_is_refused(bad: float, field: str) -> None:
    with pytest.raises(ValidationError, match=field):
        LinkSetting(**{"down_kbps": 1, "up_kbps": 1, field: bad})


@pytest.mark.parametrize("changes", [{"delay_ms": 60_001}, {"jitter_ms": 60_001}, {"loss_pct": 100.1}])
def test_delay_jitter_and_loss_are_bounded(changes: dict[str, float]) -> None:
    with pytest.raises(ValidationError, match=next(iter(changes))):
        LinkSetting(down_kbps=1, up_kbps=1, **changes)


def test_a_setting_is_read_from_json_with_whole_numbers_and_defaults() -> None:
    assert parse(LinkSetting, b'{"down_kbps": 5000, "up_kbps": 0.5}') == LinkSetting(5000, 0.5, 0, 0, 0)
