"""The command `tigas paper`: the parts of the published evaluation, which a single file describes."""

from __future__ import annotations

import json
import os
import shlex
import subprocess
import sys
import time
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated, Any, Self

from pydantic import ValidationError
from rich.table import Table

from tigas_common.command import POSITIONAL, Command, Metavar
from tigas_common.errors import StartError
from tigas_common.files import change_owner_to_caller
from tigas_common.parsing import describe_error
from tigas_common.processes import handle_sigterm_as_ctrl_c
from tigas_common.terminal import make_console
from tigas_common.wire.model import WireModel
from tigas_experiments.commands.experiment import Labs, command_as_typed, run_experiment

if TYPE_CHECKING:  # heavy
    from tigas_experiments.run.plan import ExperimentPlan

PROGRESS = "part.json"


class Part(WireModel):
    name: str
    shows: str
    """The tables and figures that the part makes."""
    minutes: float
    """Approximate time on the machine in `on`."""
    on: str = "2 cores"
    """Minimum machine."""
    like: str | None = None
    """Part from which to inherit experiment keys."""
    experiment: dict[str, Any] | None = None
    """Keys of an experiment file."""
    then: tuple[str, ...] = ()
    """Commands to run on the part's folder, {out}, after its runs."""


class Progress(WireModel):
    """The content of part.json in a part's folder."""

    seconds: float = 0.0
    """Time spent so far."""
    done: bool = False

    @classmethod
    def read(cls, folder: Path) -> Self:
        try:
            return cls.model_validate_json((folder / PROGRESS).read_bytes())
        except (OSError, ValidationError):
            return cls()

    def write(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / PROGRESS).write_text(self.model_dump_json() + "\n", encoding="utf-8")


class Evaluation(WireModel):
    """The file with all parts."""

    experiment: dict[str, Any]
    """Experiment keys shared by all parts."""
    parts: tuple[Part, ...]
    inputs: dict[str, str]
    """Commands that make input files from the recordings and scenes in {data}, by path from the repository's root."""

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read the file. Raises StartError."""
        try:
            return cls.model_validate_json(json.dumps(tomllib.loads(path.read_text(encoding="utf-8"))))
        except OSError as error:
            raise StartError(f"{path} cannot be read ({error.strerror}): run this in a clone of TIGAS.") from None
        except tomllib.TOMLDecodeError as error:
            raise StartError(f"{path} is not TOML: {error}.") from None
        except ValidationError as error:
            raise StartError(f"{path}: {describe_error(error)}") from None

    def part(self, name: str) -> Part:
        """The part with this name. Raises StartError."""
        found = next((part for part in self.parts if part.name == name), None)
        if found is None:
            raise StartError(f"There is no part {name!r}; the parts are {', '.join(part.name for part in self.parts)}.")
        return found

    def plan(self, part: Part) -> ExperimentPlan | None:
        """The part's experiment; None for a part with commands only. Raises StartError."""
        from tigas_experiments.run.plan import ExperimentPlan

        if part.experiment is None:
            return None
        return ExperimentPlan.from_data(
            {**self.experiment, **self._keys(part), "name": part.name}, f"The part {part.name}"
        )

    def _keys(self, part: Part) -> dict[str, Any]:
        inherited = {} if part.like is None else self._keys(self.part(part.like))
        return {**inherited, **(part.experiment or {})}

    def needed_inputs(self, part: Part) -> list[str]:
        """The files of `inputs` that a part uses."""
        plan = self.plan(part)
        names = () if plan is None else (*plan.movements, *plan.networks)
        scenes = () if plan is None else tuple(f"models/{scene}/" for scene in plan.scenes)
        return [path for path in self.inputs if path.removeprefix("experiments/") in names or path.startswith(scenes)]


class Paper(Command):
    """Make or continue a part of the published evaluation. Without PART, list the parts."""

    part: Annotated[str | None, POSITIONAL, Metavar("PART")] = None
    """Part to make."""
    data: Path | None = None
    """Folder with the recordings and scenes that most parts need."""
    out: Path = Path("results/paper")
    """Folder for the results, with a subfolder for each part."""
    file: Path = Path("experiments/paper.toml")
    """File that describes the parts."""
    labs: Labs = 1
    """Number of labs among which to divide the runs; each needs at least two processors."""
    allow_changes: bool = False
    """Continue even if the commit, browser, ladder or a scene has changed."""

    def run(self) -> None:
        evaluation = Evaluation.read(self.file)
        if self.part is None:
            make_console().print(self._listed(evaluation))
            return
        handle_sigterm_as_ctrl_c()
        part = evaluation.part(self.part)
        making = _PartMaker(self.file.parent, self.out / part.name, self.data)
        making.inputs({path: evaluation.inputs[path] for path in evaluation.needed_inputs(part)})
        before, began, done = Progress.read(making.out), time.monotonic(), False
        try:
            self._make(making, evaluation.plan(part), part.then, before)
            done = True
        finally:
            Progress(seconds=before.seconds + time.monotonic() - began, done=done).write(making.out)
            change_owner_to_caller(making.out)

    def _make(self, making: _PartMaker, plan: ExperimentPlan | None, then: Sequence[str], before: Progress) -> None:
        from tigas_experiments.report.cli import Report
        from tigas_experiments.run.experiment import Experiment

        complete = before.done
        if plan is not None:
            made = Experiment.from_plan(plan, making.directory, making.out, command_as_typed())
            complete = complete and not made.missing()
            if not complete:
                run_experiment(made, labs=self.labs, allow_changes=self.allow_changes)
        if complete:
            print(f"{making.out} is complete.")
            return
        making.out.mkdir(parents=True, exist_ok=True)
        for command in then:
            making.shell(command)
        if plan is not None and then:
            Report(folder=making.out).run()

    def _listed(self, evaluation: Evaluation) -> Table:
        table = Table("Part", "Shows", "On", "Minutes", "Done")
        for part in evaluation.parts:
            progress = Progress.read(self.out / part.name)
            took = f"{progress.seconds / 60:.0f}" if progress.done else f"about {part.minutes:g}"
            began = "begun" if progress.seconds else ""
            table.add_row(part.name, part.shows, part.on, took, "yes" if progress.done else began)
        return table


@dataclass(frozen=True, slots=True)
class _PartMaker:
    directory: Path
    """Folder to which the experiment's paths are relative."""
    out: Path
    data: Path | None

    def inputs(self, commands: dict[str, str]) -> None:
        """Make missing input files. Raises StartError."""
        root = self.directory.resolve().parent
        missing = {root / path: command for path, command in commands.items() if not (root / path).exists()}
        for path, command in missing.items():
            path.parent.mkdir(parents=True, exist_ok=True)
            self.shell(command, path)

    def shell(self, command: str, path: Path | None = None) -> None:
        """Run a command from the file. Raises StartError."""
        if "{data}" in command and (self.data is None or not self.data.is_dir()):
            raise StartError(
                f"{self.out.name} needs recordings or scenes that are not part of TIGAS: name their folder with --data "
                f"(make paper PART={self.out.name} DATA=../shared; docs/experiments.md)."
            )
        tools = os.environ | {"PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ.get('PATH', '')}"}
        with TemporaryDirectory() as scratch:
            filled = command
            for name, value in (("out", self.out), ("data", self.data), ("path", path), ("tmp", scratch)):
                filled = filled.replace(f"{{{name}}}", shlex.quote(str(value)))
            print(f"== {filled.strip()}", flush=True)
            made = False
            try:
                made = subprocess.run(["bash", "-euc", filled], env=tools, stdin=subprocess.DEVNULL).returncode == 0
            finally:
                if path is not None and not made:
                    path.unlink(missing_ok=True)
            if not made:
                raise StartError(f"{self.out.name} stopped because this failed: {filled.strip()}")
