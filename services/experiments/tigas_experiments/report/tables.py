"""The tables as files: runs.csv with a row for each run, groups.csv with a row for each group, differences.csv with a
row for each figure of a controller against the baseline, rate_distortion.csv and equal_rates.csv of quality against
rate, system.csv and picture_scores.csv of the system panel and the heat maps, what_to_use.csv of which mode is the best
when; overall.md and what_to_use.md, for papers and docs.

An empty cell of a CSV file is a metric that there is not; `inf` is a time that never came.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from tigas_experiments.records.folder import RunRecord
from tigas_experiments.report import what_to_use
from tigas_experiments.report.blocks import LEAST_BLOCKS, Estimate
from tigas_experiments.report.controllers import Controller
from tigas_experiments.report.differences import Difference
from tigas_experiments.report.groups import Condition, Group, Groups, Overall
from tigas_experiments.report.metrics import METRICS, RECEIVED, TABLE, Metric
from tigas_experiments.report.picture_scores import Row as PictureRow
from tigas_experiments.report.picture_scores import computed, rows_of
from tigas_experiments.report.rate_distortion import QUALITIES, RateDistortion, by_condition, over_all
from tigas_experiments.report.results import Failure, Results, Run
from tigas_experiments.report.system_figure import METRICS as SYSTEM_METRICS
from tigas_experiments.report.system_figure import mean_parts

Row = dict[str, Any]


def write_csv(
    results: Results, groups: Groups, compared: Sequence[Difference], baseline: Controller | None, folder: Path
) -> list[Path]:
    """All CSV files. Raises OSError."""
    runs = [*map(_run, results.runs), *map(_failure, results.failures)]
    files = {
        "runs.csv": sorted(runs, key=lambda row: str(row["folder"])),
        "groups.csv": [_group(group) for group in groups],
        "system.csv": [row for group in groups for row in _system(group)],
        "picture_scores.csv": [cell for row in rows_of(groups) for cell in _picture_scores(row)],
        "differences.csv": [_difference(each, baseline.name, metric) for each in compared for metric in METRICS]
        if baseline is not None
        else [],
        "rate_distortion.csv": [row for found in by_condition(groups) for row in _rate_distortion(found)],
        "equal_rates.csv": [
            row
            for found in (over_all(groups), *by_condition(groups))
            if found is not None
            for row in _equal_rates(found)
        ],
        "what_to_use.csv": list(what_to_use.rows(what_to_use.places(groups))),
    }
    return [_write(folder / name, rows) for name, rows in files.items()]


def overall_markdown(rows: Sequence[Overall]) -> str:
    """Means alone."""
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


def what_to_use_markdown(results: Results, found: Sequence[what_to_use.Place]) -> str:
    """What the runs were made with, and each mode's means at each place: the best in bold, and in italics those of
    which no difference from it is shown.
    """
    metrics = {question: answer.metric for place in found for question, answer in place.answers.items()}
    if not metrics:
        return "No two modes were measured over one network.\n"
    headings = " | ".join(metric.heading for metric in metrics.values())
    lines = [
        *_made_with(results),
        "",
        f"| network | round trip, ms | scene | mode | {headings} |",
        "|---|---:|---|---|" + "---:|" * len(metrics),
    ]
    for place in found:
        cells: dict[str, dict[str, str]] = {}
        for question, answer in place.answers.items():
            for each in answer.contenders:
                mark = {"best": "**" * answer.decided, "no difference shown": "*"}.get(each.verdict, "")
                cells.setdefault(each.name, {})[question] = f"{mark}{answer.metric.text(each.mean)}{mark}"
        for name, row in cells.items():
            where = (place.network, rtt_text(place.rtt_ms), place.scene_text, name.replace("*", "\\*"))
            lines.append(f"| {' | '.join([*map(escaped, where), *(row.get(each, '') for each in metrics)])} |")
    return "\n".join(lines) + "\n"


def rtt_text(rtt_ms: float | None) -> str:
    """As it stands in a table."""
    return "its own" if rtt_ms is None else f"{rtt_ms:g}"


def _made_with(results: Results) -> list[str]:
    """Lines of Markdown."""
    records = [run.record for run in results.runs]
    commits, lengths, viewports, processors = (
        " and ".join(sorted(set(each)))
        for each in zip(
            *(
                (
                    record.machine.commit or "unknown",
                    f"{record.configuration.duration_s:g} s",
                    f"{record.configuration.width}×{record.configuration.height}",
                    f"{record.machine.processors}",
                )
                for record in records
            ),
            strict=True,
        )
    )
    saturated = sum(run.saturated for run in results.runs)
    return [
        f"{len(records)} runs of {lengths} at {viewports}, commit {commits}, {processors} processors, the",
        f"bottleneck in {saturated} runs (\\*). Means over the blocks that all modes have. **Bold**: the best;",
        f"*italics*: no difference from the best is shown; neither with fewer than {LEAST_BLOCKS} blocks.",
    ]


def _run(run: Run) -> Row:
    figures = {metric.name: metric.of(run.record, run.figures) for metric in METRICS}
    shares = {f"profile_{rung}_pct": 100 * share for rung, share in run.figures.rungs.share.items()}
    return {"folder": run.folder, "status": "complete", "problem": "", **_record(run.record), **figures, **shares}


def _failure(failure: Failure) -> Row:
    record = failure.record
    status = record.status if record is not None and record.status != "complete" else "broken"
    return {
        "folder": failure.folder,
        "status": status,
        "problem": failure.reason,
        **(_record(record) if record else {}),
    }


def _record(record: RunRecord) -> Row:
    condition = Condition.of(record)
    load = record.load
    return {
        "network": condition.network,
        "rtt_ms": condition.rtt_ms,
        "controller": condition.controller.name,
        **_flat("configuration", record.configuration.model_dump(mode="json")),
        "started": record.started,
        "tigas": record.machine.tigas,
        "commit": record.machine.commit,
        "browser": record.browser,
        "link_made_by": record.backend,
        "scene_bytes": record.scene_bytes,
        "scene_sha256": record.scene_sha256,
        "processors": record.machine.processors,
        "processors_busy_pct": None if load is None else 100 * load.cpu_mean,
        "saturated_pct": None if load is None else 100 * load.saturated_share,
        "saturated": None if load is None else load.saturated,
    }


def _group(group: Group) -> Row:
    condition = group.condition
    configurations = [run.record.configuration for run in group.runs]
    row: Row = {
        "network": condition.network,
        "rtt_ms": condition.rtt_ms,
        "mode": condition.controller.mode,
        "controller": condition.controller.name,
        "runs": len(group.runs),
        "blocks": len(group.every_block),
        "runs_saturated": sum(run.saturated for run in group.runs),
        "scenes": _names(configuration.scene for configuration in configurations),
        "movements": _names(Path(configuration.movement).name for configuration in configurations),
    }
    for metric in METRICS:
        spread = group.spread(metric)
        row[f"{metric.name}_mean"] = spread and spread.mean
        row[f"{metric.name}_min"] = spread and spread.low
        row[f"{metric.name}_max"] = spread and spread.high
        row[f"{metric.name}_ci95_low"], row[f"{metric.name}_ci95_high"] = _ends(group.estimate(metric))
    return row


def _difference(difference: Difference, baseline: str, metric: Metric) -> Row:
    estimate = difference.estimate(metric)
    low, high = _ends(estimate)
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


def _system(group: Group) -> Iterator[Row]:
    """What the system panel shows; nothing of groups without the server's times."""
    parts = mean_parts(group)
    if parts:
        condition = group.condition
        shown = {metric.name: (spread := group.spread(metric)) and spread.mean for metric in SYSTEM_METRICS}
        yield {
            "network": condition.network,
            "rtt_ms": condition.rtt_ms,
            "controller": condition.controller.name,
            "runs": len(group.runs),
            **{f"{name}_ms": mean for name, mean in parts.items()},
            **shown,
        }


def _picture_scores(row: PictureRow) -> Iterator[Row]:
    """A row for each metric."""
    for metric in computed([row]):
        mean = row.mean(metric)
        if mean is not None and row.condition is not None:
            yield {
                "network": row.condition.network,
                "rtt_ms": row.condition.rtt_ms,
                "controller": row.condition.controller.name,
                "picture": row.what,
                "model": row.model,
                "metric": metric.name,
                "variant": metric.variant,
                "runs": row.runs,
                "pictures": mean.pictures,
                "mean": mean.mean,
                "std": mean.deviation,
            }


def _rate_distortion(found: RateDistortion) -> Iterator[Row]:
    """A row for each block of each controller."""
    for series in found.series:
        for controller, samples in series.samples.items():
            for block, sample in samples.items():
                yield {
                    "network": found.network,
                    "rtt_ms": found.rtt_ms,
                    "controller": controller.name,
                    "fixed": controller.fixed,
                    "trace_offset_s": block.trace_offset_s,
                    "scene": block.scene,
                    "movement": block.movement,
                    "movement_offset_s": block.movement_offset_s,
                    **{metric.name: sample.get(metric) for metric in (RECEIVED, *QUALITIES)},
                }


def _equal_rates(found: RateDistortion) -> Iterator[Row]:
    """A row for each quality of each series against each curve."""
    for each in found.equal_rates:
        for metric in QUALITIES:
            estimate = each.differences.get(metric)
            low, high = _ends(estimate)
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


def _ends(estimate: Estimate | None) -> tuple[float | None, float | None]:
    return (None, None) if estimate is None or estimate.interval is None else estimate.interval


def _names(names: Iterable[str]) -> str:
    return " ".join(sorted(set(names)))


def _flat(prefix: str, value: Any) -> Row:
    """Nested fields as columns of their own: configuration_network_link_down_kbps."""
    if isinstance(value, dict):
        return {name: cell for key, inner in value.items() for name, cell in _flat(f"{prefix}_{key}", inner).items()}
    return {prefix: value}


def _write(path: Path, rows: Sequence[Row]) -> Path:
    columns = list(dict.fromkeys(name for row in rows for name in row))
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(map(_cell, columns))
        writer.writerows([_cell(row.get(name)) for name in columns] for row in rows)
    return path


def _cell(value: Any) -> Any:
    """Text that a spreadsheet would take for a formula has an apostrophe before it, as OWASP has it; numbers stay."""
    if not isinstance(value, str):
        return value
    text = value.replace("\r", " ")  # which would end the row, as Python does not quote it
    return f"'{text}" if value.startswith(("=", "+", "-", "@", "\t", "\r", "\n")) else text


def escaped(text: str) -> str:
    """As a cell of a Markdown table."""
    return " ".join(text.split()).replace("|", "\\|")
