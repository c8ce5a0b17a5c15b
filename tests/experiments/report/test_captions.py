"""The words of figures."""

from __future__ import annotations

from tigas_experiments.report.captions import short


def test_names_are_shortened_in_their_middle() -> None:
    assert short("report_bus_0001") == "report_bus_0001"
    assert short("driving_B_2019.12.16_14.23.32.csv.gz") == "driving_B…2.csv.gz"
    assert len(short("x" * 100)) == 18
