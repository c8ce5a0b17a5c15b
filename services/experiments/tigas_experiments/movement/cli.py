"""The commands `tigas movement …`. Heavy modules are imported when a command runs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from tigas_common.command import POSITIONAL, Command, Group, Metavar
from tigas_common.errors import StartError
from tigas_common.terminal import make_console, printable

if TYPE_CHECKING:
    from tigas_experiments.movement.trace import MovementTrace

PICTURES = (".png", ".svg", ".pdf")
_EYES = {"left": "left eye", "right": "right eye", "middle": "middle of both eyes"}


class Make(Command):
    """Generate a movement."""

    kind: Annotated[str, POSITIONAL]
    """Kind of movement: stroll, look-around, quick-turns or orbit."""
    out: Annotated[Path, POSITIONAL]
    """Output file."""
    seconds: Annotated[float, Field(ge=1, le=7200)] = 60
    """Duration."""
    seed: int = 1
    """Random seed."""

    def run(self) -> None:
        from tigas_experiments.movement.generated import KINDS, generate

        if self.kind not in KINDS:
            raise StartError(f"Unknown movement {self.kind!r}: choose one of {', '.join(KINDS)}.")
        _write(generate(self.kind, self.seconds, self.seed), self.out)


class Import(Command):
    """Convert an EyeNavGS recording to a movement.

    With --settings, it becomes a walk from the start camera of any scene; otherwise, it stays in the recorded scene.
    """

    recording: Annotated[Path, POSITIONAL]
    """EyeNavGS CSV file, from either site."""
    out: Annotated[Path, POSITIONAL]
    """Output file."""
    eye: Literal["left", "right", "middle"] = "middle"
    """Eye to follow."""
    up: Annotated[str | None, Metavar("X,Y,Z")] = None
    """Up axis from the scene's scene.json, if it has one; by default 0,-1,0. Not allowed with --settings."""
    settings: Path | None = None
    """The site's scene_setting.csv, with the scale and level of the recorded scene."""
    metre: Annotated[float | None, Field(gt=0, lt=1e6)] = None
    """Units per metre in the scene to walk in; by default, the start camera's subject is 4 m away."""

    def run(self) -> None:
        from dataclasses import replace

        from tigas_experiments.movement import eyenavgs

        way = eyenavgs.read_eyes(self.recording, self.eye)
        if self.settings is None:
            if self.metre is not None:
                raise StartError("--metre needs --settings.")
            made = eyenavgs.to_recorded_scene(way, _axis(self.up or "0,-1,0"))
            changes = "in the scene's own place"
        else:
            if self.up is not None:
                raise StartError("--up cannot be combined with --settings.")
            chosen = eyenavgs.read_settings(self.settings, eyenavgs.scene_name(self.recording))
            made = eyenavgs.to_start_anchor(way, chosen)
            changes = (
                f"levelled, divided by the scene's scale {chosen.scale:g}, moved and turned to begin at the origin"
            )
            if self.metre is not None:
                made = replace(made, positions=made.positions * self.metre, unit="scene")
                changes += f", times {self.metre:g}"
        comments = {
            "description": f"{self.recording.stem} of EyeNavGS, {_EYES[self.eye]}",
            "source": f"{eyenavgs.SOURCE}, {self.recording.name}",
            "licence": f"Apache-2.0; changed by TIGAS: {_EYES[self.eye]}, OpenCV's axes, {changes}; gaze left out",
        }
        _write(replace(made, comments=comments), self.out)


class Show(Command):
    """Print a movement's duration, sampling rate, distance and speed."""

    file: Annotated[Path, POSITIONAL]
    """Movement trace."""
    plot: Path | None = None
    """Also draw a plot: .png, .svg or .pdf."""

    def run(self) -> None:
        from rich.table import Table

        from tigas_experiments.movement.summary import Summary, plot_movement
        from tigas_experiments.movement.trace import GAP_MS, MovementTrace

        if self.plot is not None and self.plot.suffix.lower() not in PICTURES:
            raise StartError(f"{self.plot}: the file name must end in {', '.join(PICTURES)}.")
        trace = MovementTrace.read(self.file)
        summary, gaps = Summary.from_trace(trace), trace.gaps_ms
        unit = "m" if trace.unit == "m" else "units"
        begins = {"start": "at the scene's start camera", "scene": "where it is in the scene"}
        facts = Table(show_header=False, box=None)
        for key, value in (
            *trace.comments.items(),
            ("begins", begins[trace.anchor]),
            ("duration", f"{summary.duration_s:g} s in {summary.poses:,} poses"),
            ("rate", f"{summary.median_rate_hz:.1f}/s, longest step {summary.longest_step_ms:.0f} ms"),
            ("gaps", f"{len(gaps)}, together {gaps.sum() / 1000:g} s" if len(gaps) else f"none > {GAP_MS:g} ms"),
            ("way", f"{summary.path:.1f} {unit}, {summary.speed:.2f} {unit}/s on average"),
            *(("note", note) for note in trace.notes),
        ):
            facts.add_row(key, value)
        turning = Table(box=None)
        turning.add_column("turning")
        for percent in summary.turning:
            turning.add_column({50: "median", 100: "max"}.get(percent, f"{percent} %"), justify="right")
        turning.add_row("degrees/s", *(f"{value:.0f}" for value in summary.turning.values()))
        if self.plot is not None:
            plot_movement(trace, self.file.stem, self.plot)
        console = make_console(soft_wrap=True)
        console.print(facts)
        console.print(turning)
        if self.plot is not None:
            print(self.plot)


movement = Group("Generate, import and inspect movement traces.", {"make": Make, "import": Import, "show": Show})


def _axis(text: str) -> list[float]:
    import math

    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if len(values) != 3 or not 0 < math.hypot(*values) < math.inf:
        raise StartError(f"--up takes 3 numbers such as 0,0,1, not {text!r}.")
    return values


def _write(trace: MovementTrace, out: Path) -> None:
    text = trace.to_csv()
    trace.parse(text, f"What would be written to {out}")  # fails for positions enlarged by a tiny scale, for example
    try:
        with out.open("x", encoding="utf-8", newline="\n") as file:
            file.write(text)
    except FileExistsError:
        raise StartError(f"{out} exists; remove it first, or choose another file.") from None
    print(f"{out}: {len(trace.times_ms):,} poses, {trace.duration_ms / 1000:g} s")
    for note in trace.notes:
        print(printable(note))
