"""The system panel: latency broken down, bandwidth, median resolution, profile switches and rendering time."""

from __future__ import annotations

from collections.abc import Iterable

from matplotlib.axes import Axes

from tigas_experiments.report.captions import at_lowest, short, spread_of
from tigas_experiments.report.charts import draw_points
from tigas_experiments.report.groups import Group, Groups
from tigas_experiments.report.latency_parts import PART_TITLES
from tigas_experiments.report.metrics import MEDIAN_HEIGHT, RECEIVED, RENDER_MEAN, SWITCHES
from tigas_experiments.report.plot import MOST_COLUMNS, Plot, legend_entries, panel_grid, style, svg

METRICS = (RECEIVED, MEDIAN_HEIGHT, SWITCHES, RENDER_MEAN)
PART_COLOURS = ("#bbbbbb", "#88ccee", "#0072b2", "#44aa99", "#d55e00", "#cc79a7", "#ddcc77")


def system_panel(groups: Groups) -> Plot | None:
    """Each controller over each network, at its lowest round trip. None where no reply tells of the server's times."""
    columns = {name: groups.at(name, groups.base_rtt(name)) for name in groups.networks}
    every = [group for column in columns.values() for group in column]
    parts = {group: found for group in every if (found := mean_parts(group))}
    if not parts:
        return None
    metrics = [metric for metric in METRICS if any(group.spread(metric) for group in every)]
    with style():
        figure, (stacked, *panels) = panel_grid(1 + len(metrics))
        _draw_parts(stacked, parts)
        for axes, metric in zip(panels, metrics, strict=True):
            draw_points(axes, columns, metric, groups.looks)
            axes.set_xticks(range(len(columns)), [short(name) for name in columns])
        figure.legend(
            *zip(*((handle, label) for label, handle in legend_entries(panels).items()), strict=True),
            loc="outside upper left",
            ncols=MOST_COLUMNS * 2,
            fontsize=8,
        )
        stacked.legend(fontsize=7, loc="upper left", bbox_to_anchor=(0, -0.22), ncols=2)
        slowest = max(parts, key=lambda group: sum(parts[group].values()))
        largest = max(parts[slowest], key=lambda name: parts[slowest][name])
        title = (
            f"The oldest frames are those of {slowest.controller.title} over {slowest.condition.network}, "
            f"{sum(parts[slowest].values()):,.0f} ms; the largest part: {PART_TITLES[largest].lower()}"
        )
        caption = (
            f"Each controller over each network, {at_lowest(groups)}. {spread_of(every)} The age of a frame is the sum "
            "of its parts: the wait from an input to its request, the server's queue, rendering and encoding, the "
            "network both ways, the page's enhancement, and the page otherwise with the wait for the display."
        )
        return Plot("system", title, caption, svg(figure), "system.csv")


def mean_parts(group: Group) -> dict[str, float]:
    """ms, over the runs of a group; empty where they tell of none."""
    found = [run.parts.by_name for run in group.runs if run.parts is not None]
    return {name: sum(each[name] for each in found) / len(found) for name in PART_TITLES} if found else {}


def _draw_parts(axes: Axes, parts: dict[Group, dict[str, float]]) -> None:
    labels = [_label(group, parts) for group in parts]
    left = [0.0] * len(parts)
    for (name, title), colour in zip(PART_TITLES.items(), PART_COLOURS, strict=True):
        values = [each[name] for each in parts.values()]
        axes.barh(range(len(parts)), values, left=left, color=colour, label=title, height=0.7)
        left = [before + value for before, value in zip(left, values, strict=True)]
    axes.set_yticks(range(len(parts)), labels)
    axes.invert_yaxis()
    axes.grid(visible=False, axis="y")
    axes.set(title="Mean frame age, ms (lower is better)", xlim=(0, None))


def _label(group: Group, every: Iterable[Group]) -> str:
    one_network = len({each.condition.network for each in every}) == 1
    return group.controller.title if one_network else f"{group.controller.title}, {short(group.condition.network)}"
