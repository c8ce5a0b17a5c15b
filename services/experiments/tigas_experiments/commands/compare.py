"""The command `tigas compare`: an experiment planned by options."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

from tigas_common.command import Metavar
from tigas_common.errors import StartError
from tigas_experiments.commands.options import Measure, command_as_typed, end_as_ctrl_c, make_runs
from tigas_experiments.wire.run import USUALLY_COMPARED

CAPTURE_EVERY_S = 0.5
"""Interval of the pictures kept to measure quality."""


class Compare(Measure):
    """Compare one JPEG per pose with low-latency DASH over the same movement and network, and write a report.

    An experiment's file has more options: `tigas experiment run`.
    """

    scene: Annotated[str, Metavar("ID")] = "courtyard"
    """Scene."""
    movement: Annotated[str, Metavar("FILE|NAME")] = "stroll"
    """Movement trace, or the name of a generated movement."""
    networks: tuple[str, ...] = ("20mbit,20ms-rtt",)
    """Constant link such as 20mbit,20ms-rtt, network trace (a file, or its name at the shaper), or `unshaped`."""
    modes: str = ",".join(USUALLY_COMPARED)
    """Modes to compare, separated by commas; `video` is another."""
    profiles: tuple[str, ...] = ("seen",)
    """Controller of stateless and video, or a fixed rung of the ladder."""
    duration: float = 60
    """Seconds of movement per run."""
    viewport: Annotated[str, Metavar("WIDTHxHEIGHT")] = "640x360"
    """Size of the view in pixels."""
    out: Path | None = None
    """Folder for the report; results/compare-TIME unless named."""

    def run(self) -> None:
        from tigas_experiments.report.cli import Report
        from tigas_experiments.run.experiment import Experiment, reserved
        from tigas_experiments.run.plan import ExperimentPlan

        end_as_ctrl_c()
        folder = self.out or Path("results", f"compare-{datetime.now(UTC):%Y%m%d-%H%M%S}")
        if folder.exists():
            raise StartError(f"{folder} already exists; choose another folder with --out.")
        plan = ExperimentPlan.of(
            {
                "name": folder.name,
                "scenes": [self.scene],
                "movements": [self.movement],
                "networks": self.networks,
                "modes": [mode.strip() for mode in self.modes.split(",")],
                "controllers": self.profiles,
                "duration_s": self.duration,
                "viewport": self.viewport,
                "capture_every_s": CAPTURE_EVERY_S,
                "shuffled": False,  # the page shows them in the order of creation
            },
            "This comparison cannot be made",
        )
        made = Experiment.of(plan, Path(), folder, command_as_typed())
        try:
            with reserved(made):
                make_runs(made, self.url)
        finally:  # Ctrl+C also leaves a report of the finished runs
            if made.begun:
                Report(folder=folder).run()
        if made.missing():
            raise SystemExit(1)
