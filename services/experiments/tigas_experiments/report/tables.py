"""The tables as files: runs.csv (the run table), groups.csv, differences.csv, equal_rates.csv, picture_scores.csv and
overall.md.

An empty CSV cell is a missing figure; `inf` is a time that was never reached.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from tigas_experiments.records.load import Load
from tigas_experiments.report.controllers import Controller
from tigas_experiments.report.differences import Difference
from tigas_experiments.report.groups import Group, Groups, Overall
from tigas_experiments.report.metrics import METRICS, TABLE, Metric
from tigas_experiments.report.picture_scores import Row as PictureRow
from tigas_experiments.report.picture_scores import computed, rows_of
from tigas_experiments.report.rate_distortion import QUALITIES, RateDistortion, by_condition, over_all
from tigas_experiments.report.results import Results
from tigas_experiments.report.run_table import Row, run_table


def write_csv(
    results: Results, groups: Groups, compared: Sequence[Difference], baseline: Controller | None, folder: Path
) -> list[Path]:
    """Write all CSV files. Raises OSError."""
    distortions = [found for found in (over_all(groups), *by_condition(groups)) if found is not None]
    files = {
        "runs.csv": run_table(results, groups),
        "groups.csv": [_group(group) for group in groups],
        "picture_scores.csv": [cell for row in rows_of(groups) for cell in _picture_scores(row)],
        "differences.csv": [
            _difference(each, baseline.name, metric) for each in compared for metric in METRICS.values()
        ]
        if baseline is not None
        else [],
        "equal_rates.csv": [row for found in distortions for row in _equal_rates(found)],
    }
    return [_write(folder / name, rows) for name, rows in files.items()]


def overall_markdown(rows: Sequence[Overall]) -> str:
    """Means over all networks, for papers."""
    if not rows:
        return "No controller was measured over all networks at one round trip.\n"
    lines = [
        "| round trip, ms | controller | runs | " + " | ".join(metric.heading for metric in TABLE) + " |",
        "|---:|---|---:|" + "---:|" * len(TABLE),
    ]
    for row in rows:
        means = [metric.text(spread.mean if (spread := row.spread(metric)) else None) for metric in TABLE]
        lines.append(f"| {rtt_text(row.rtt_ms)} | {escaped(row.name)} | {row.runs} | {' | '.join(means)} |")
    return "\n".join(lines) + "\n"


def rtt_text(rtt_ms: float | None) -> str:
    """A round trip as a table cell."""
    return "varies" if rtt_ms is None else f"{rtt_ms:g}"


def pegged_text(load: Load | None) -> str:
    """The busiest saturated thread as a table cell."""
    if load is None or load.pegged is None:
        return "unknown"
    if load.worst_pegged is None:
        return "never"
    process, share = load.worst_pegged
    return f"{100 * share:.0f} % ({process})"


def _group(group: Group) -> Row:
    condition = group.condition
    configurations = [run.record.configuration for run in group.runs]
    row: Row = {
        "network": condition.network,
        "rtt_ms": condition.rtt_ms,
        "mode": condition.controller.mode,
        "controller": condition.controller.name,
        "runs": len(group.runs),
        "blocks": len(group.all_blocks),
        "runs_saturated": sum(run.saturated for run in group.runs),
        "scenes": _names(configuration.scene for configuration in configurations),
        "movements": _names(Path(configuration.movement).name for configuration in configurations),
    }
    for metric in METRICS.values():
        spread, estimate = group.spread(metric), group.estimate(metric)
        row[f"{metric.name}_mean"] = spread and spread.mean
        row[f"{metric.name}_min"] = spread and spread.low
        row[f"{metric.name}_max"] = spread and spread.high
        row[f"{metric.name}_ci95_low"], row[f"{metric.name}_ci95_high"] = estimate.ends if estimate else (None, None)
    return row


def _difference(difference: Difference, baseline: str, metric: Metric) -> Row:
    estimate = difference.estimate(metric)
    low, high = estimate.ends if estimate else (None, None)
    return {
        "network": "all" if difference.network is None else difference.network,
        "networks": len(difference.pairs),
        "rtt_ms": difference.rtt_ms,
        "controller": difference.controller.name,
        "baseline": baseline,
        "figure": metric.name,
        "blocks": 0 if estimate is None else estimate.blocks,
        "difference": None if estimate is None or math.isnan(estimate.mean) else estimate.mean,
        "ci95_low": low,
        "ci95_high": high,
    }


def _picture_scores(row: PictureRow) -> Iterator[Row]:
    """One row for each metric."""
    for metric in computed([row]):
        mean = row.mean(metric)
        if mean is not None and row.condition is not None:
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
    """One row for each quality of each series against each curve."""
    for each in found.equal_rates:
        for metric in QUALITIES:
            estimate = each.differences.get(metric)
            low, high = estimate.ends if estimate else (None, None)
            yield {
                "network": found.network or "all",
                "rtt_ms": found.rtt_ms,
                "curve": each.curve.title,
                "compared": each.other.title,
                "figure": metric.name,
                "blocks": each.blocks,
                "blocks_overlapping": each.overlapping,
                "from_mbit_s": each.rates and each.rates[0],
                "to_mbit_s": each.rates and each.rates[1],
                "difference": estimate and estimate.mean,
                "ci95_low": low,
                "ci95_high": high,
            }


def _names(names: Iterable[str]) -> str:
    return " ".join(sorted(set(names)))


def _write(path: Path, rows: Sequence[Row]) -> Path:
    columns = list(dict.fromkeys(name for row in rows for name in row))
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(map(_cell, columns))
        writer.writerows([_cell(row.get(name)) for name in columns] for row in rows)
    return path


def _cell(value: Any) -> Any:
    """Prefix text that a spreadsheet would run as a formula with an apostrophe, as OWASP recommends."""
    if not isinstance(value, str):
        return value
    text = value.replace("\r", " ")  # ends the row, because Python does not quote it
    return f"'{text}" if value.startswith(("=", "+", "-", "@", "\t", "\r", "\n")) else text


def escaped(text: str) -> str:
    """Text as a cell of a Markdown table."""
    return " ".join(text.split()).replace("|", "\\|")
