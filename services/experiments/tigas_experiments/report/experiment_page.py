"""The page of an experiment: claims, figures, and tables over groups of runs."""

from __future__ import annotations

from pathlib import Path

from tigas_experiments.report.blocks import LEAST_BLOCKS, signed
from tigas_experiments.report.claims import claims
from tigas_experiments.report.experiment_figures import figures
from tigas_experiments.report.groups import Groups, Spread, overall
from tigas_experiments.report.metrics import TABLE, Metric
from tigas_experiments.report.plot import Plot
from tigas_experiments.report.rate_distortion import QUALITIES, by_condition, over_all
from tigas_experiments.report.results import Results, Told
from tigas_experiments.report.tables import overall_markdown, rtt_text, what_to_use_markdown
from tigas_experiments.report.what_to_use import QUESTIONS, places, tally


def experiment_page(results: Results, groups: Groups, out: Path, told: Told) -> dict[str, object]:
    """What its template is filled with; writes tables in Markdown and the figures as SVG, too. Raises OSError."""
    totals = overall(groups)
    (out / "overall.md").write_text(overall_markdown(totals), encoding="utf-8")
    for old in out.glob("[0-9][0-9]-*_*.svg"):  # of a report that had other networks
        old.unlink()
    for name in ("motivation.svg", "rate-distortion.svg"):  # which other runs may not have
        (out / name).unlink(missing_ok=True)
    plots: dict[str | None, list[Plot]] = {}
    for count, (network, plot) in enumerate(figures(groups), 1):
        (out / f"{plot.name}.svg").write_text(plot.svg, encoding="utf-8")
        plots.setdefault(network, []).append(plot)
        told("draws figures", count, None)
    found = places(groups)
    (out / "what_to_use.md").write_text(what_to_use_markdown(results, found), encoding="utf-8")
    return {
        "claims": claims(groups),
        "groups": groups,
        "overview": plots.pop(None, []),
        "by_network": plots,
        "totals": totals if len(groups.networks) > 1 else [],
        "table": TABLE,
        "cell": cell,
        "signed": signed,
        "least_blocks": LEAST_BLOCKS,
        "distortions": [
            one for one in (over_all(groups), *by_condition(groups)) if one is not None and one.equal_rates
        ],
        "qualities": QUALITIES,
        "rtt_text": rtt_text,
        "places": found,
        "tally": tally(found),
        "questions": [question for question in QUESTIONS if any(question in place.answers for place in found)],
        "durations": sorted({f"{run.record.configuration.duration_s:g} s" for group in groups for run in group.runs}),
    }


def cell(spread: Spread | None, metric: Metric) -> tuple[str, str | None]:
    """The mean; from the least to the greatest, where they differ."""
    if spread is None:
        return metric.text(None), None
    low, high = metric.text(spread.low), metric.text(spread.high)
    return metric.text(spread.mean), None if low == high else f"{low}–{high}"
