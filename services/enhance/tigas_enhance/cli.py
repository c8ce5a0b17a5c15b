"""The commands `tigas enhance train` and `evaluate`. Heavy modules are imported when a command runs."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from tigas_common.cli import load_settings
from tigas_common.command import POSITIONAL, Command, Group, Metavar
from tigas_common.errors import StartError
from tigas_common.processes import interrupt_on_sigterm
from tigas_common.terminal import make_console, progress_bar

if TYPE_CHECKING:
    import torch

    from tigas_enhance.renderer import Renderer
    from tigas_enhance.tuning import Listener

SECONDS = {"cpu": 180.0, "cuda": 60.0}
EVALUATED_VIEWS = 12


class _EnhanceCommand(Command):
    """A command that compares renderings of scenes."""

    render: Annotated[str | None, Metavar("URL")] = None
    """URL of a running render service; by default, one is started."""
    device: Annotated[str, Metavar("auto|cpu|cuda[:N]")] = "auto"
    """Device for computation, and for rendering if a service is started."""

    def _weights_path(self, name: str | None) -> Path:
        """Path of a scene's weights: next to its file, in the render service's models directory."""
        from tigas_common.weights import FILE

        if name is None:
            raise StartError("--general needs the path of a file: --out.")
        scenes: Path = load_settings("render").scenes
        folder = scenes / name
        if Path(name).name != name or not folder.is_dir():
            raise StartError(f"{scenes} has no folder {name!r}.")
        return folder / FILE

    def _device(self) -> torch.device:
        import torch

        if self.device == "auto":
            return torch.device("cuda" if torch.cuda.is_available() else "cpu")
        try:
            device = torch.device(self.device)
        except RuntimeError:
            raise StartError(f"There is no device {self.device!r}: choose auto, cpu, cuda or cuda:N.") from None
        if (device.type == "cuda" and (device.index or 0) >= torch.cuda.device_count()) or device.type not in SECONDS:
            raise StartError(f"There is no device {self.device!r} on this machine.")
        return device

    @contextmanager
    def _renderer(self, *, own_ladders: bool = True) -> Iterator[Renderer]:
        """The running service, or one that runs during the context."""
        from tigas_common.render_requests import run_render_service
        from tigas_enhance.renderer import Renderer

        with ExitStack() as stack:
            started = run_render_service(self.device, ladder="scene" if own_ladders else "paper")
            yield stack.enter_context(Renderer.connect(self.render or stack.enter_context(started)))


class Train(_EnhanceCommand):
    """Train networks on a scene's own views, and write them next to the scene. If stopped, nothing changes."""

    names: Annotated[tuple[str, ...], POSITIONAL, Metavar("SCENE")]
    """Scenes to train on."""
    general: bool = False
    """Train one set on all scenes, for use with any scene."""
    out: Path | None = None
    """Output file; by default enhance.safetensors next to the scene."""
    seconds: Annotated[float | None, Field(ge=1, le=36_000)] = None
    """Training time for each set; by default 60 on a GPU and 180 on a CPU."""
    json_: bool = False
    """Report progress as lines of JSON."""

    def run(self) -> None:
        from tigas_common.weights import write_weights
        from tigas_enhance.tuning import tune

        with interrupt_on_sigterm():
            sets = [self.names] if self.general else [[name] for name in self.names]
            if self.out is not None and len(sets) > 1:
                raise StartError("--out needs a single set: give one scene, or --general.")
            files = [self.out or self._weights_path(None if self.general else each[0]) for each in sets]
            where = self._device()
            with self._renderer(own_ladders=not self.general) as renderer:
                for each, file in zip(sets, files, strict=True):
                    with _progress_listener(self.json_) as listener:
                        weights = tune(
                            renderer, each, self.seconds or SECONDS[where.type], where, listener, general=self.general
                        )
                    write_weights(file, weights)
                    if not self.json_:
                        print(f"{file}: " + ", ".join(f"rung {n.rung} {n.gain_db:+.2f} dB" for n in weights.networks))


class Evaluate(_EnhanceCommand):
    """Compare networks with bicubic enlargement on held-out views of a scene, at display size."""

    name: Annotated[str, POSITIONAL, Metavar("SCENE")]
    """Scene to evaluate."""
    weights: Path | None = None
    """Weights file; by default enhance.safetensors next to the scene."""

    def run(self) -> None:
        from rich.table import Table

        from tigas_common.weights import read_weights
        from tigas_enhance.evaluate import compute_scores, confidence_interval
        from tigas_enhance.network import to_network
        from tigas_enhance.pairs import ScenePairs

        read = read_weights(self.weights or self._weights_path(self.name))
        where = self._device()
        with self._renderer() as renderer:
            scene = renderer.load(self.name)
            ladder = renderer.ladder(scene)
            if problem := read.misfit(scene.file_sha256, ladder):
                raise StartError(problem)
            networks = {rung: network for rung, each in enumerate(ladder) if (network := read.network_for(each))}
            pairs = ScenePairs(renderer, scene, ladder, tuple(networks)).held_out(EVALUATED_VIEWS)
        table = Table("rung", "bicubic", "enhanced", "gain, dB", "95 %", "SSIM", box=None)
        for rung, network in networks.items():
            plain = compute_scores(pairs, rung, None, where)
            better = compute_scores(pairs, rung, to_network(network, read), where)
            gains = better.psnr - plain.psnr
            low, high = confidence_interval(gains)
            table.add_row(
                f"{rung}  {ladder[rung].width} × {ladder[rung].height}",
                f"{plain.psnr.mean():.2f} dB",
                f"{better.psnr.mean():.2f} dB",
                f"{gains.mean():+.2f}",
                f"{low:+.2f} to {high:+.2f}",
                f"{plain.ssim.mean():.4f} → {better.ssim.mean():.4f}",
            )
        make_console().print(table)


enhance = Group(
    "Train the networks that enhance a scene's low rungs, and test them.", {"train": Train, "evaluate": Evaluate}
)


@contextmanager
def _progress_listener(as_json: bool) -> Iterator[Listener]:
    """Report progress with a bar, or with a line of JSON per percent."""
    if as_json:
        said = -1.0

        def say(stage: str, done: float) -> None:
            nonlocal said
            if done >= said + 0.01:
                said = done
                print(json.dumps({"stage": stage, "progress": round(done, 3)}), flush=True)

        yield say
        return
    with progress_bar() as bar:
        yield lambda stage, done: bar(done, stage)
