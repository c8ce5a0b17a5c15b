"""The lab's reader and placer against the page's golden file."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from tests.experiments.movement.golden import FILE, MOVEMENTS, REFUSED, golden
from tigas_experiments.movement.table import MovementError
from tigas_experiments.movement.trace import MovementTrace

KEPT: dict[str, Any] = json.loads(FILE.read_text(encoding="utf-8"))


def test_each_movement_is_where_it_was_in_each_scene() -> None:
    now = golden()
    assert {key: KEPT[key] for key in ("movements", "refused", "scenes")} == {
        key: json.loads(json.dumps(now[key])) for key in ("movements", "refused", "scenes")
    }
    for kept, made in zip(KEPT["placed"], now["placed"], strict=True):
        assert (kept["movement"], kept["scene"]) == (made["movement"], made["scene"])
        assert [point["t_ms"] for point in kept["points"]] == [point["t_ms"] for point in made["points"]]
        for key in ("position", "quaternion"):
            expected, got = (np.array([point[key] for point in of["points"]]) for of in (kept, made))
            if key == "quaternion":  # its negative is the same rotation
                got *= np.sign((got * expected).sum(axis=1, keepdims=True))
            np.testing.assert_allclose(got, expected, atol=1e-12, err_msg=f"{kept['movement']} in {kept['scene']}")


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_no_movement_is_refused_with_one_sentence(name: str) -> None:
    with pytest.raises(MovementError, match=r"^walk\.csv[^\n]+\.$"):
        MovementTrace.parse(REFUSED[name], "walk.csv")


@pytest.mark.parametrize("name", MOVEMENTS)
def test_what_is_written_is_read_back(name: str) -> None:
    trace = MovementTrace.parse(MOVEMENTS[name], name)
    again = MovementTrace.parse(trace.text(), name)
    assert again.text() == trace.text()
    np.testing.assert_allclose(again.positions, trace.positions, atol=1e-6)
    np.testing.assert_allclose(again.quaternions, trace.quaternions, atol=2e-6)
    assert (again.anchor, again.unit, again.comments) == (trace.anchor, trace.unit, trace.comments)
