"""The commands `tigas movement …`. Heavy imports wait until a command runs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from tigas_common.cli import in_a_sentence
from tigas_common.errors import StartError
from tigas_common.terminal import make_console, printable

if TYPE_CHECKING:
    from tigas_experiments.movement.eyenavgs import SceneSettings
    from tigas_experiments.movement.trace import MovementTrace

movement = typer.Typer(help="Generate, import and inspect movement traces.", no_args_is_help=True)

Out = Annotated[Path, typer.Argument(help="Output file.")]
Force = Annotated[bool, typer.Option("--force", help="Overwrite an existing file.")]
PICTURES = (".png", ".svg", ".pdf")


@movement.command("make")
def make(
    kind: Annotated[str, typer.Argument(help="stroll, look-around, quick-turns or orbit.")],
    out: Out,
    seconds: Annotated[float, typer.Option(min=1, max=7200, help="Duration.")] = 60,
    seed: Annotated[int, typer.Option(help="Random seed.")] = 1,
    force: Force = False,
) -> None:
    """Generate a movement."""
    from tigas_experiments.movement.generated import KINDS, generate

    with in_a_sentence(StartError, OSError):
        if kind not in KINDS:
            raise StartError(f"Unknown movement {kind!r}: choose one of {', '.join(KINDS)}.")
        _write(generate(kind, seconds, seed), out, force)


@movement.command("import")
def import_(
    recording: Annotated[Path, typer.Argument(help="An EyeNavGS CSV, from either site.")],
    out: Out,
    eye: Annotated[Literal["left", "right", "middle"], typer.Option(help="Eye to follow.")] = "middle",
    anchor: Annotated[
        Literal["scene", "start"],
        typer.Option(help="Keep it in its recorded scene, or make it a walk from any scene's start camera."),
    ] = "scene",
    up: Annotated[
        str | None,
        typer.Option(help="x,y,z: the up axis in the scene's scene.json, if it has one.", show_default="0,-1,0"),
    ] = None,
    settings: Annotated[
        Path | None, typer.Option(help="The site's scene_setting.csv, for the scale and level of the recorded scene.")
    ] = None,
    scale: Annotated[float | None, typer.Option(help="Units per metre in the recorded scene.")] = None,
    level: Annotated[
        str | None, typer.Option(help="x,y,z,w: the quaternion that levels the recorded scene.", show_default="0,0,0,1")
    ] = None,
    metre: Annotated[
        float | None,
        typer.Option(
            help="Units per metre in the scene to walk in.", show_default="the start camera's subject is 4 m away"
        ),
    ] = None,
    force: Force = False,
) -> None:
    """Convert an EyeNavGS recording to a movement."""
    from dataclasses import replace

    from tigas_experiments.movement import eyenavgs

    with in_a_sentence(StartError, OSError):
        way = eyenavgs.read_eyes(recording, eye)
        if anchor == "scene":
            if any(value is not None for value in (settings, scale, level, metre)):
                raise StartError("--settings, --scale, --level and --metre need --anchor start.")
            made = eyenavgs.in_its_scene(way, _numbers(up or "0,-1,0", 3, "--up"))
            changes = "in the scene's own place"
        else:
            if up is not None:
                raise StartError("--up needs --anchor scene.")
            chosen = _settings(recording, settings, scale, level)
            made = eyenavgs.from_the_start(way, chosen)
            changes = (
                f"levelled, divided by the scene's scale {chosen.scale:g}, moved and turned to begin at the origin"
            )
            if metre is not None:
                if not 0 < metre < 1e6:
                    raise StartError("--metre must be a positive number of units.")
                made = replace(made, positions=made.positions * metre, unit="scene")
                changes += f", times {metre:g}"
        comments = {
            "description": f"{recording.stem} of EyeNavGS, {_EYES[eye]}",
            "source": f"{eyenavgs.SOURCE}, {recording.name}",
            "licence": f"Apache-2.0; changed by TIGAS: {_EYES[eye]}, OpenCV's axes, {changes}; gaze left out",
        }
        _write(replace(made, comments=comments), out, force)


_EYES = {"left": "left eye", "right": "right eye", "middle": "middle of both eyes"}


@movement.command("show")
def show(
    file: Annotated[Path, typer.Argument(help="A movement trace.")],
    plot: Annotated[Path | None, typer.Option(help="Also plot it, to a .png, .svg or .pdf.")] = None,
) -> None:
    """Print a movement's duration, sampling rate, distance and speed."""
    from rich.table import Table

    from tigas_experiments.movement.summary import Summary
    from tigas_experiments.movement.trace import GAP_MS, MovementTrace

    with in_a_sentence(StartError, OSError):
        if plot is not None and plot.suffix.lower() not in PICTURES:
            raise StartError(f"{plot}: the file name must end in {', '.join(PICTURES)}.")
        trace = MovementTrace.read(file)
        summary, gaps = Summary.of(trace), trace.gaps_ms
        unit = "m" if trace.unit == "m" else "units"
        begins = {"start": "at the scene's start camera", "scene": "where it is in the scene"}
        facts = Table(show_header=False, box=None)
        for key, value in trace.comments.items():
            facts.add_row(key, value)
        facts.add_row("begins", begins[trace.anchor])
        facts.add_row("duration", f"{summary.duration_s:g} s in {summary.poses:,} poses")
        facts.add_row("rate", f"{summary.median_rate_hz:.1f}/s, longest step {summary.longest_step_ms:.0f} ms")
        facts.add_row(
            "gaps", f"{len(gaps)}, together {gaps.sum() / 1000:g} s" if len(gaps) else f"none > {GAP_MS:g} ms"
        )
        facts.add_row("way", f"{summary.path:.1f} {unit}, {summary.speed:.2f} {unit}/s on average")
        for note in trace.notes:
            facts.add_row("note", note)
        turning = Table(box=None)
        turning.add_column("turning")
        for percent in summary.turning:
            turning.add_column({50: "median", 100: "max"}.get(percent, f"{percent} %"), justify="right")
        turning.add_row("degrees/s", *(f"{value:.0f}" for value in summary.turning.values()))
        if plot is not None:
            from tigas_experiments.movement.plot import plot_movement

            plot_movement(trace, file.stem, plot)
    console = make_console(soft_wrap=True)
    console.print(facts)
    console.print(turning)
    if plot is not None:
        print(plot)


def _settings(recording: Path, file: Path | None, scale: float | None, level: str | None) -> SceneSettings:
    from tigas_experiments.movement import eyenavgs

    if file is not None:
        if scale is not None or level is not None:
            raise StartError("--settings already gives scale and level.")
        return eyenavgs.read_settings(file, eyenavgs.scene_of(recording))
    if scale is None:
        raise StartError(
            "A walk is in metres: give the scene's scale with --scale, or use --settings scene_setting.csv."
        )
    try:
        return eyenavgs.settings(scale, _numbers(level or "0,0,0,1", 4, "--level"))
    except ValueError as error:
        raise StartError(f"--scale and --level: {error}.") from None


def _numbers(text: str, count: int, option: str) -> list[float]:
    """Finite numbers, not all of them 0."""
    import math

    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if len(values) != count or not all(map(math.isfinite, values)) or not any(values):
        raise StartError(f"{option} takes {count} numbers such as {','.join(['0'] * (count - 1))},1, not {text!r}.")
    return values


def _write(trace: MovementTrace, out: Path, force: bool) -> None:
    text = trace.text()
    trace.parse(text, f"What would be written to {out}")  # such as positions that a tiny scale made too large
    try:
        with out.open("w" if force else "x", encoding="utf-8", newline="\n") as file:
            file.write(text)
    except FileExistsError:
        raise StartError(f"{out} exists; use --force to overwrite it.") from None
    print(f"{out}: {len(trace.times_ms):,} poses, {trace.duration_ms / 1000:g} s")
    for note in trace.notes:
        print(printable(note))
