"""The report of a measurement, including steps without figures."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

from rich.console import Console

from benchmarks.load.measure import Capacity
from benchmarks.load.report import draw, line, table, write_json
from tests.benchmarks.load.test_measure import GOOD

NOTHING = replace(
    GOOD, viewers=9, outside=9, fates={"outside": 300}, p50_ms=math.nan, p95_ms=math.nan, frames_per_s=0.0,
    kilobytes=math.nan, server=None,
)  # fmt: skip
SLOW = replace(GOOD, viewers=60, fates={"served": 200, "superseded": 90, "late": 10}, p50_ms=90, p95_ms=900)


def test_a_step_is_told_on_a_line() -> None:
    assert line(GOOD) == "   1 viewers:      30 frames/s, p50   10.0, p95   20.0 ms, 100.00 % served"
    assert line(SLOW).endswith(" 66.67 % served; 10 late, 90 superseded")
    assert line(NOTHING).endswith("  0.00 % served; 300 outside, 9 viewers outside")


def test_the_table_has_a_row_for_each_step() -> None:
    console = Console(width=200)
    with console.capture() as capture:
        console.print(table([GOOD, SLOW, NOTHING], "webtransport"))
    assert [row.split()[0] for row in capture.get().splitlines() if "%" in row] == ["1", "60", "9"]
    assert [" ".join(row.split()).count(" 1.00 210 42 ") for row in capture.get().splitlines() if "%" in row] == [
        1,
        1,
        0,
    ]


def test_json_has_null_for_what_is_unknown(tmp_path: Path) -> None:
    write_json(tmp_path / "load.json", [GOOD, NOTHING], {"title": "webtransport"})
    written = json.loads((tmp_path / "load.json").read_text(), parse_constant=lambda name: 1 / 0)
    assert [step["p95_ms"] for step in written["steps"]] == [20, None]
    assert [step["served"] for step in written["steps"]] == [1, 0]


def test_the_chart_has_both_panels_and_no_step_that_says_nothing(tmp_path: Path) -> None:
    capacity = Capacity(100, viewers=40, found=True, steps=[GOOD, replace(GOOD, viewers=40), NOTHING], beyond=[SLOW])
    draw(capacity, 30, "webtransport", tmp_path / "load.svg")
    drawing = (tmp_path / "load.svg").read_text()
    assert all(text in drawing for text in ("Frames/s", "last byte", "p95", "p50", "delivered"))
    draw(Capacity(100, steps=[NOTHING]), 30, "webtransport", tmp_path / "none.svg")
    assert not (tmp_path / "none.svg").exists()
