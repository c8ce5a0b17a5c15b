"""The run table: one row per run with its configuration, machine and figures. `runs.csv` is this table."""

from __future__ import annotations

from typing import Any

from tigas_experiments.records.folder import RunRecord
from tigas_experiments.report.groups import Condition, Groups
from tigas_experiments.report.results import Failure, Results, Run

Row = dict[str, Any]


def run_table(results: Results, groups: Groups) -> list[Row]:
    """All runs, sorted by folder; `compared` marks the runs in means and differences."""
    compared = {run.folder for group in groups for run in group.runs}
    rows = [
        *(_complete(run, run.folder in compared) for run in results.runs),
        *(_failed(failure) for failure in results.failures),
    ]
    return sorted(rows, key=lambda row: str(row["folder"]))


def _complete(run: Run, compared: bool) -> Row:
    return {
        "folder": run.folder,
        "status": "complete",
        "problem": "",
        "compared": compared,
        **_record(run.record),
        **run.values,
        **{f"profile_{profile}_pct": 100 * share for profile, share in run.profile_shares.items()},
    }


def _failed(failure: Failure) -> Row:
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
    busiest = None if load is None else load.worst_pegged
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
        "processors_usable": None if load is None else load.processors,
        "processors_busy_pct": None if load is None else 100 * load.cpu_mean,
        "saturated_pct": None if load is None else 100 * load.saturated_share,
        "saturated": None if load is None else load.saturated,
        "pegged_thread_of": None if busiest is None else busiest[0],
        "pegged_thread_pct": None if busiest is None else 100 * busiest[1],
        "services_watched": None if load is None else load.services,
    }


def _flat(prefix: str, value: Any) -> Row:
    """Nested fields as columns such as configuration_network_link_down_kbps."""
    if isinstance(value, dict):
        return {name: cell for key, inner in value.items() for name, cell in _flat(f"{prefix}_{key}", inner).items()}
    return {prefix: value}
