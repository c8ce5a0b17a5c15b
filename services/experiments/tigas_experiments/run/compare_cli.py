"""The command `tigas compare`."""

from __future__ import annotations

import asyncio
import shlex
import sys
from pathlib import Path
from typing import Annotated

import typer
from pydantic import ValidationError

from tigas_common.cli import in_a_sentence
from tigas_common.errors import StartError
from tigas_common.parsing import sentence
from tigas_common.wire.run import MODES, Configuration, Network
from tigas_experiments.run.parsing import capture_interval_ms, parse_network, parse_viewport

DEFAULT_NETWORK = "20mbit,20ms-rtt"
DEFAULT_PROFILE = "budget"


def compare(
    scene: Annotated[str, typer.Option(help="The scene's id.")] = "courtyard",
    movement: Annotated[str, typer.Option(help="A movement trace's file, or the name of a generated one.")] = "stroll",
    network: Annotated[
        list[str] | None,
        typer.Option(
            help="A constant link such as 20mbit,20ms-rtt, a network trace's file, a trace's name in --traces, or "
            "`unshaped`. May be given several times.",
            show_default=DEFAULT_NETWORK,
        ),
    ] = None,
    modes: Annotated[str, typer.Option(help="What to compare, separated by commas.")] = ",".join(MODES),
    duration: Annotated[float, typer.Option(help="Seconds of movement a run.")] = 60,
    viewport: Annotated[str, typer.Option(help="WIDTHxHEIGHT in pixels.")] = "640x360",
    profile: Annotated[
        list[str] | None,
        typer.Option(
            help="Stateless: a controller's name, or a fixed rung of the ladder. May be given several times.",
            show_default=DEFAULT_PROFILE,
        ),
    ] = None,
    seed: Annotated[int, typer.Option(help="Of generated movements and of the controllers' random numbers.")] = 1,
    capture_every: Annotated[float, typer.Option(help="Seconds between pictures kept for quality; 0 keeps none.")] = 1,
    warm_up: Annotated[float, typer.Option(help="Seconds before the movement begins.")] = 5,
    out: Annotated[
        Path | None, typer.Option(help="Folder for the report.", show_default="results/compare-TIME")
    ] = None,
    url: Annotated[str | None, typer.Option(help="Measure running services instead of starting the lab.")] = None,
    scenes: Annotated[Path | None, typer.Option(help="The lab's models directory: one folder a scene.")] = None,
    traces: Annotated[Path | None, typer.Option(help="The lab's directory of network traces.")] = None,
) -> None:
    """Compare one JPEG per pose with low-latency DASH: same movement, same network, and a report to cite."""
    from tigas_experiments.run.compare import Comparison, default_out, make_runs, report_on
    from tigas_experiments.run.signals import end_as_ctrl_c
    from tigas_experiments.run.terminal import print_report, progress

    end_as_ctrl_c()
    with in_a_sentence(StartError, OSError):
        width, height = _viewport(viewport)
        runs = [
            _configuration(
                scene=scene,
                movement=movement,
                network=each,
                mode=mode.strip(),
                duration_s=duration,
                width=width,
                height=height,
                profile=int(chosen) if chosen.isdecimal() else chosen,
                seed=seed,
                capture_every_ms=capture_interval_ms(capture_every, duration),
                warm_up_s=warm_up,
            )
            for each in map(_network, network or [DEFAULT_NETWORK])
            for mode in modes.split(",")
            for chosen in (profile or [DEFAULT_PROFILE] if mode.strip() == "stateless" else [DEFAULT_PROFILE])
        ]
        comparison = Comparison(
            runs=runs,
            out=out or default_out(),
            command=shlex.join(["tigas", *sys.argv[1:]]),
            url=url,
            scenes=scenes,
            traces=traces,
        )
        if comparison.out.exists():
            raise StartError(f"{comparison.out} exists already; choose another folder with --out.")
        made: list[Path] = []
        try:
            with progress(runs) as listener:
                asyncio.run(make_runs(comparison, listener, made))
        finally:  # Ctrl+C, too, leaves a report of what there is
            if made:
                report = report_on(comparison, made)
                print_report(report, comparison.out)
    if report.unreadable or any(run.figures is None for run in report.runs):
        raise typer.Exit(1)


def _network(text: str) -> Network:
    try:
        return parse_network(text)
    except ValidationError as error:
        raise typer.BadParameter(f"{text!r}: {sentence(error)}", param_hint="--network") from None
    except ValueError as error:
        raise typer.BadParameter(str(error), param_hint="--network") from None


def _configuration(**fields: object) -> Configuration:
    try:
        return Configuration.model_validate(fields)
    except ValidationError as error:
        raise typer.BadParameter(sentence(error)) from None


def _viewport(text: str) -> tuple[int, int]:
    try:
        return parse_viewport(text)
    except ValueError as error:
        raise typer.BadParameter(str(error), param_hint="--viewport") from None
