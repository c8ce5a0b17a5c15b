"""Tables as files: runs.csv (the run table), groups.csv, differences.csv, equal_rates.csv, picture_scores.csv and
overall.md.

An empty CSV cell is a missing metric; `inf` is a time that was never reached.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Collection, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from tigas_experiments.report.estimates import MIN_WINDOWS, Estimate, signed_text, significant
from tigas_experiments.report.groups import Difference, Group, Groups
from tigas_experiments.report.metrics import METRICS, TABLE, select_metrics
from tigas_experiments.report.picture_scores import computed_metrics, rows_of
from tigas_experiments.report.rate_distortion import QUALITIES, RateDistortion
from tigas_experiments.report.run_table import Results, Row, run_table

SEEN, RECEIVED = select_metrics("seen_ssim", "received_mbit_s")
BEST = ("experiment", "round trip, ms", "best picture on the screen", "SSIM", "Mbit/s", "not certainly worse")
"""Columns about the controller with the highest SSIM at display time over all networks, and the controllers that are
not significantly worse."""


def write_csv(
    results: Results,
    groups: Groups,
    differences: Sequence[Difference],
    distortions: Sequence[RateDistortion],
    folder: Path,
) -> list[Path]:
    """Write all CSV files. Raises OSError."""
    files = {
        "runs.csv": run_table(results, {run for group in groups for run in group.runs}),
        "groups.csv": [_group(group) for group in groups],
        "picture_scores.csv": _picture_scores(groups),
        "differences.csv": [row for each in differences for row in _difference(each)],
        "equal_rates.csv": [row for each in distortions for row in _equal_rates(each)],
    }
    return [_write(folder / name, [*rows]) for name, rows in files.items()]


def overall_markdown(rows: Sequence[Group]) -> str:
    """Means over all networks, for papers."""
    if not rows:
        return "No controller was measured over all networks at one round trip.\n"
    headings = ["round trip, ms", "controller", "runs", *(metric.heading for metric in TABLE)]
    lines = []
    for row in rows:
        means = [None if (found := row.estimate(metric)) is None else found.mean for metric in TABLE]
        lines.append([*row.labels[1:], *(metric.text(mean) for metric, mean in zip(TABLE, means, strict=True))])
    return markdown_table(headings, lines, left=["controller"])


def best_rows(groups: Groups, experiment: str) -> list[list[str]]:
    """A row of BEST for each round trip at which all networks have captures of several controllers."""
    rows = []
    everywhere = groups.overall() if len(groups.networks) > 1 else groups
    several = len({controller.mode for controller in groups.looks}) > 1

    def title(row: Group | Difference) -> str:
        controller = row.condition.controller
        return controller.title_with_mode if several else controller.title

    for condition in dict.fromkeys(group.condition[:2] for group in everywhere):
        own = {group: group.estimate(SEEN) for group in everywhere if group.condition[:2] == condition}
        means = {group: estimate.mean for group, estimate in own.items() if estimate is not None}
        if len(means) < 2:
            continue
        first = max(means, key=lambda group: means[group])
        pairs = {
            pair: pair.estimate(SEEN) for pair in groups.against(first.controller) if pair.condition[:2] == condition
        }
        known = {pair: estimate for pair, estimate in pairs.items() if estimate and estimate.interval}
        worse = significant(known.values())
        alike = (
            f"{title(pair)} ({signed_text(SEEN, estimate.mean)} {estimate.interval_text(SEEN)})"
            for pair, estimate in known.items()
            if estimate not in worse
        )
        rate = first.estimate(RECEIVED)
        cells = (title(first), SEEN.text(means[first]), RECEIVED.text(None if rate is None else rate.mean))
        others = "; ".join(alike) or "none" if known else f"unknown: fewer than {MIN_WINDOWS} network windows"
        rows.append([experiment, first.labels[1], *cells, others])
    return rows


def best_markdown(rows: Sequence[Sequence[str]]) -> str:
    return markdown_table(BEST, rows, left=["experiment", BEST[2], BEST[-1]])


def markdown_table(headings: Sequence[str], rows: Iterable[Sequence[str]], left: Collection[str]) -> str:
    """A Markdown table with right-aligned columns, except for the columns `left`."""
    rule = "|".join("---" if heading in left else "---:" for heading in headings)
    lines = (" | ".join(" ".join(cell.split()).replace("|", "\\|") for cell in row) for row in rows)
    return "".join((f"| {' | '.join(headings)} |\n|{rule}|\n", *(f"| {line} |\n" for line in lines)))


def _group(group: Group) -> Row:
    network, rtt_ms, controller = group.condition
    row: Row = {
        "network": network,
        "rtt_ms": rtt_ms,
        "mode": controller.mode,
        "controller": controller.name,
        "runs": len(group.runs),
        "blocks": len(group.all_blocks),
        "runs_saturated": sum(run.saturated for run in group.runs),
        "scenes": " ".join(sorted({block.scene for block in group.all_blocks})),
        "movements": " ".join(sorted({block.movement for block in group.all_blocks})),
    }
    for name, metric in METRICS.items():
        found = group.estimate(metric)
        row |= {f"{name}_mean": found and found.mean, f"{name}_min": found and found.low}
        row |= {f"{name}_max": found and found.high, **_interval(found, f"{name}_")}
    return row


def _difference(difference: Difference) -> Iterator[Row]:
    network, rtt_ms, controller = difference.condition
    for name, metric in METRICS.items():
        found = difference.estimate(metric)
        yield {
            "network": network,
            "networks": len(difference.pairs),
            "rtt_ms": rtt_ms,
            "controller": controller.name,
            "baseline": difference.baseline.name,
            "figure": name,
            "blocks": 0 if found is None else found.blocks,
            "difference": None if found is None or math.isnan(found.mean) else found.mean,
            **_interval(found),
        }


def _picture_scores(groups: Groups) -> Iterator[Row]:
    for row in rows_of(groups):
        for metric in computed_metrics([row]):
            mean = row.mean(metric)
            assert mean is not None
            assert row.condition is not None
            yield {
                "network": row.condition.network,
                "rtt_ms": row.condition.rtt_ms,
                "controller": row.condition.controller.name,
                "picture": row.kind,
                "model": row.model,
                "metric": metric.name,
                "variant": metric.variant,
                "runs": row.runs,
                "pictures": mean.pictures,
                "mean": mean.mean,
                "std": mean.deviation,
            }


def _equal_rates(found: RateDistortion) -> Iterator[Row]:
    """One row for each quality metric of each series against each curve."""
    for each in found.equal_rates:
        for metric in QUALITIES:
            estimate = each.differences[metric]
            yield {
                "network": found.network,
                "rtt_ms": found.rtt_ms,
                "curve": each.curve.title,
                "compared": each.other.title,
                "figure": metric.name,
                "blocks": each.blocks,
                "blocks_overlapping": len(each.ranges),
                "from_mbit_s": each.rates and each.rates[0],
                "to_mbit_s": each.rates and each.rates[1],
                "difference": estimate and estimate.mean,
                **_interval(estimate),
            }


def _interval(estimate: Estimate | None, prefix: str = "") -> Row:
    low, high = (estimate and estimate.interval) or (None, None)
    return {f"{prefix}ci95_low": low, f"{prefix}ci95_high": high}


def _write(path: Path, rows: Sequence[Row]) -> Path:
    columns = list(dict.fromkeys(name for row in rows for name in row))
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(map(_cell, columns))
        writer.writerows([_cell(row.get(name)) for name in columns] for row in rows)
    return path


def _cell(value: Any) -> Any:
    """Prefix text that a spreadsheet would execute as a formula with an apostrophe, as OWASP recommends."""
    if not isinstance(value, str):
        return value
    text = value.replace("\r", " ")  # ends the row, as Python does not quote it
    return f"'{text}" if value.startswith(("=", "+", "-", "@", "\t", "\r", "\n")) else text
