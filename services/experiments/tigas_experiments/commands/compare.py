"""The command `tigas compare`: an experiment with one plan and its own report page."""

from __future__ import annotations

import asyncio
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer

from tigas_common.cli import in_a_sentence
from tigas_common.errors import StartError
from tigas_common.terminal import make_console
from tigas_common.wire.run import OFF, USUALLY_COMPARED
from tigas_experiments.commands.options import Scenes, Traces, Url, command_as_typed

DEFAULT_NETWORK = "20mbit,20ms-rtt"
DEFAULT_PROFILE = "budget"
DEFAULT_MODES = "stateless,dash-typical,dash-tuned,dash-edge"


def compare(
    scene: Annotated[str, typer.Option(help="Scene id.")] = "courtyard",
    movement: Annotated[
        str, typer.Option(help="A movement trace file, or the name of a generated movement.")
    ] = "stroll",
    network: Annotated[
        list[str] | None,
        typer.Option(
            help="A constant link such as 20mbit,20ms-rtt, a network trace file, a trace name in --traces, or "
            "`unshaped`. Repeatable.",
            show_default=DEFAULT_NETWORK,
        ),
    ] = None,
    modes: Annotated[str, typer.Option(help="What to compare, comma-separated; `video` is another.")] = ",".join(
        USUALLY_COMPARED
    ),
    duration: Annotated[float, typer.Option(help="Seconds of movement per run.")] = 60,
    viewport: Annotated[str, typer.Option(help="WIDTHxHEIGHT in pixels.")] = "640x360",
    profile: Annotated[
        list[str] | None,
        typer.Option(
            help="Stateless and video: a controller, or a fixed rung of the ladder. Repeatable.",
            show_default=DEFAULT_PROFILE,
        ),
    ] = None,
    ladder: Annotated[
        str, typer.Option(metavar="scene|paper", help="What rungs count in: the scene's own ladder, or the paper's.")
    ] = "scene",
    reprojection: Annotated[
        bool, typer.Option("--reprojection", help="Turn the newest frame to each animation frame's pose.")
    ] = False,
    prediction: Annotated[
        str, typer.Option(help="What predicts the poses that frames are asked for, such as auto, or off.")
    ] = OFF,
    dash_frame_rate: Annotated[
        int | None, typer.Option(help="DASH frames per second: 30 or 60.", show_default="the preset's")
    ] = None,
    dash_representation: Annotated[
        list[str] | None,
        typer.Option(
            help="DASH: `adaptive`, or a single representation such as r2-1414 (rung 2, 1414 kbit/s). Repeatable.",
            show_default="adaptive",
        ),
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of generated movements and of the controllers' random numbers.")] = 1,
    capture_every: Annotated[
        float, typer.Option(help="Seconds between pictures kept to measure quality; 0 keeps none.")
    ] = 0.5,
    sample_stride: Annotated[
        int, typer.Option(help="Stateless: sample every n-th shown frame to render it again later; 0 samples none.")
    ] = 0,
    warm_up: Annotated[float, typer.Option(help="Seconds before the movement begins.")] = 5,
    out: Annotated[
        Path | None, typer.Option(help="Folder for the report.", show_default="results/compare-TIME")
    ] = None,
    repeats: Annotated[int, typer.Option(help="Runs of each combination.")] = 1,
    url: Url = None,
    scenes: Scenes = None,
    traces: Traces = None,
) -> None:
    """Compare one JPEG per pose with low-latency DASH over the same movement and network, and write a report."""
    from tigas_experiments.report.cli import report
    from tigas_experiments.run.plan import ADAPTIVE, Plan
    from tigas_experiments.run.progress import progress
    from tigas_experiments.run.runner import Experiment, make_missing_runs, reserved
    from tigas_experiments.run.signals import end_as_ctrl_c

    end_as_ctrl_c()
    with in_a_sentence(StartError, OSError):
        folder = out or Path("results", f"compare-{datetime.now(UTC):%Y%m%d-%H%M%S}")
        if folder.exists():
            raise StartError(f"{folder} already exists; choose another folder with --out.")
        plan = Plan.of(
            {
                "name": folder.name,
                "scenes": [scene],
                "movements": [movement],
                "networks": network or [DEFAULT_NETWORK],
                "modes": [mode.strip() for mode in modes.split(",")],
                "controllers": profile or [DEFAULT_PROFILE],
                "ladder": ladder,
                "reprojection": reprojection,
                "prediction": prediction,
                "dash_frame_rate": dash_frame_rate,
                "dash_representations": dash_representation or [ADAPTIVE],
                "repeats": repeats,
                "duration_s": duration,
                "viewport": viewport,
                "seed": seed,
                "capture_every_s": capture_every,
                "sample_stride": sample_stride,
                "warm_up_s": warm_up,
                "shuffled": False,  # the page has them as they were made
            },
            "This comparison cannot be made",
        )
        made = Experiment.of(plan, Path(), folder, "comparison", command_as_typed())
        try:
            with reserved(made), progress(made.runs, len(made.runs), make_console(stderr=True)) as listener:
                asyncio.run(make_missing_runs(made, made.missing(), url, scenes, traces, listener))
        finally:  # Ctrl+C, too, leaves a report of what there is
            if made.begun:
                report(folder)
        if made.missing():
            raise typer.Exit(1)
