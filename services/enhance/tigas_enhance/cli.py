"""The commands `tigas enhance train` and `evaluate`. Heavy imports wait until a command runs."""

from __future__ import annotations

import json
import signal
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tigas_common.cli import in_a_sentence
from tigas_common.errors import StartError, TigasError
from tigas_common.terminal import make_console

if TYPE_CHECKING:
    import torch

    from tigas_enhance.pairs import Renderer
    from tigas_enhance.tuning import Listener

enhance = typer.Typer(help="Train the networks that enhance a scene's low rungs, and test them.", no_args_is_help=True)

Scenes = Annotated[Path | None, typer.Option(help="Models directory.")]
Render = Annotated[
    str | None, typer.Option(metavar="URL", help="A running render service.", show_default="one is started")
]
Device = Annotated[
    str, typer.Option(metavar="auto|cpu|cuda[:N]", help="Train on this device, and render, if a service is started.")
]
SECONDS = {"cpu": 180.0, "cuda": 60.0}


@enhance.command("train")
def train(
    names: Annotated[list[str], typer.Argument(metavar="SCENE...", help="Scenes to train on.")],
    general: Annotated[bool, typer.Option("--general", help="Train one set on all of them, for any scene.")] = False,
    scenes: Scenes = None,
    render: Render = None,
    out: Annotated[
        Path | None, typer.Option(help="Output file.", show_default="enhance.safetensors beside the scene")
    ] = None,
    seconds: Annotated[
        float | None,
        typer.Option(min=1, max=36_000, help="Time for each set.", show_default="60 on a GPU, 180 on a CPU"),
    ] = None,
    device: Device = "auto",
    as_json: Annotated[bool, typer.Option("--json", help="Report progress as lines of JSON.")] = False,
) -> None:
    """Train networks on a scene's own views, and write them beside the scene. What is stopped leaves the old ones."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # so that a service that was started ends, too
    from tigas_common.weights import write_weights
    from tigas_enhance.tuning import tune

    with in_a_sentence(StartError, TigasError, OSError):
        sets = [names] if general else [[name] for name in names]
        if out is not None and len(sets) > 1:
            raise StartError("--out is for one set: give one scene, or --general.")
        files = [out or _file(scenes, None if general else each[0]) for each in sets]
        where = _device(device)
        with _renderer(render, scenes, device, own_ladders=not general) as renderer:
            for each, file in zip(sets, files, strict=True):
                with _listening(as_json) as listener:
                    weights = tune(renderer, each, seconds or SECONDS[where.type], where, listener, general=general)
                write_weights(file, weights)
                if not as_json:
                    print(f"{file}: " + ", ".join(f"rung {n.rung} {n.gain_db:+.2f} dB" for n in weights.networks))


@enhance.command("evaluate")
def evaluate(
    name: Annotated[str, typer.Argument(metavar="SCENE", help="The scene.")],
    weights: Annotated[
        Path | None, typer.Option(help="The networks.", show_default="enhance.safetensors beside the scene")
    ] = None,
    scenes: Scenes = None,
    render: Render = None,
    views: Annotated[int, typer.Option(min=2, max=24, help="Held-out views.")] = 12,
    device: Device = "auto",
) -> None:
    """Compare networks with bicubic enlargement on views of a scene that no training saw, at display size."""
    from tigas_common.weights import built_in_digest, read_weights
    from tigas_enhance.tuning import held_out_pairs

    with in_a_sentence(StartError, TigasError, OSError):
        read = read_weights(weights or _file(scenes, name))
        where = _device(device)
        with _renderer(render, scenes, device) as renderer:
            scene = renderer.load(name)
            ladder = renderer.ladder(scene)
            if problem := read.misfit(scene.file_sha256 or built_in_digest(name), ladder):
                raise StartError(problem)
            networks = {rung: network for rung, each in enumerate(ladder) if (network := read.network_for(each))}
            pairs = held_out_pairs(renderer, scene, ladder, tuple(networks), views)
        from rich.table import Table

        from tigas_enhance.evaluate import bicubic_scores, enhanced_scores, interval
        from tigas_enhance.tuning import to_network

        table = Table("rung", "bicubic", "enhanced", "gain, dB", "95 %", "SSIM", box=None)
        for rung, network in networks.items():
            plain = bicubic_scores(pairs, rung, where)
            better = enhanced_scores(pairs, rung, to_network(network, read), where)
            gains = better.psnr - plain.psnr
            low, high = interval(gains)
            table.add_row(
                f"{rung}  {ladder[rung].width} × {ladder[rung].height}",
                f"{plain.psnr.mean():.2f} dB",
                f"{better.psnr.mean():.2f} dB",
                f"{gains.mean():+.2f}",
                f"{low:+.2f} to {high:+.2f}",
                f"{plain.ssim.mean():.4f} → {better.ssim.mean():.4f}",
            )
        make_console().print(table)


def _file(scenes: Path | None, name: str | None) -> Path:
    """Where a scene's weights are: beside its file, in the models directory."""
    from tigas_common.weights import FILE

    if scenes is None or name is None:
        raise StartError("Say where the networks' file is: --out (or --weights), or a scene's folder by --scenes.")
    folder = scenes / name
    if Path(name).name != name or not folder.is_dir():
        raise StartError(f"{scenes} has no folder {name!r}.")
    return folder / FILE


def _device(name: str) -> torch.device:
    import torch

    if name == "auto":
        return torch.device("cuda" if torch.cuda.is_available() else "cpu")
    try:
        device = torch.device(name)
    except RuntimeError:
        raise StartError(f"There is no device {name!r}: choose auto, cpu, cuda or cuda:N.") from None
    if (device.type == "cuda" and (device.index or 0) >= torch.cuda.device_count()) or device.type not in SECONDS:
        raise StartError(f"There is no device {name!r} on this machine.")
    return device


@contextmanager
def _renderer(url: str | None, scenes: Path | None, device: str, *, own_ladders: bool = True) -> Iterator[Renderer]:
    """The service at a URL, or one that is started for the while."""
    from tigas_enhance.pairs import Renderer
    from tigas_enhance.renderer_process import render_service

    with ExitStack() as stack:
        started = render_service(scenes, device, own_ladders=own_ladders)
        yield stack.enter_context(Renderer(url or stack.enter_context(started)))


@contextmanager
def _listening(as_json: bool) -> Iterator[Listener]:
    """A bar for whoever watches, or a line of JSON for each hundredth."""
    if as_json:
        said = -1.0

        def say(what: str, done: float) -> None:
            nonlocal said
            if done >= said + 0.01:
                said = done
                print(json.dumps({"stage": what, "progress": round(done, 3)}), flush=True)

        yield say
        return
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (
        BarColumn(),
        TextColumn("{task.percentage:.0f} %"),
        TimeElapsedColumn(),
        TextColumn("{task.description}"),
    )
    with Progress(*columns, console=make_console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=1.0)
        yield lambda what, done: bar.update(task, description=what, completed=done)
