"""A long run of the services and the page: memory and open files stay flat, and only killed services complain.

    python -m benchmarks.soak [--minutes 120] [--kill-every 10] [--device cpu] [--out results/soak]

A headless Chromium goes through modes and scenes and walks in each. After each round it adds a scene and deletes it,
and `tigas experiment` makes a run. In turn, a service is killed and started again, as by Compose, and the page has to
show frames again. A process is flat if its memory and open files are about the same a few minutes after its start and
before its end. Writes soak.csv and soak.svg; exits with 1 if a process was not flat, ended unasked or complained.
"""

from __future__ import annotations

import argparse
import csv
import itertools
import json
import re
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import NamedTuple

import httpx
import psutil
from playwright.sync_api import ConsoleMessage, Error, Page, TimeoutError, sync_playwright
from rich.box import SIMPLE_HEAD
from rich.table import Table

from benchmarks.hostile.services import write_scene
from benchmarks.services import Service, free_ports, megabytes_of, open_files_of, started
from tigas_common.errors import StartError
from tigas_common.processes import tigas_command
from tigas_common.terminal import make_console
from tigas_experiments.report.plot import add_legend, panel_grid, plot_style, svg
from tigas_experiments.run.browser import ARGUMENTS, find_chromium

MODES = ("stateless", "video", "dash", "webrtc", "local", "side-by-side")
SCENES = ("courtyard", "ball")
KEYS = ("ArrowRight", "w", "ArrowLeft", "s")
STEP_S = 15
"""Duration of a walk."""
RECOVERY_S = 90
"""After a kill, the time for the page to show frames, and in which the logs may complain."""
SETTLE_S = 300
"""From a process's start until its memory is compared: a round through the modes and scenes."""
GROWTH_MB, GROWTH, GROWTH_FILES = 25, 0.1, 10
"""The most that a flat process grows: the greater of megabytes and a share, and a number of open files."""
EXPERIMENT_S = 300
"""Timeout of an experiment, on a busy machine."""
COMPLAINT = re.compile(r"error|traceback|exception|critical", re.IGNORECASE)
EXPERIMENT = """
name = "soak"
scenes = ["courtyard"]
movements = ["stroll"]
networks = ["unshaped"]
duration_s = 3
warm_up_s = 1
viewport = "480x270"
"""


class Sample(NamedTuple):
    at_s: float
    process: str
    start: int
    """How often it had been started."""
    megabytes: float
    files: int


@dataclass
class Supervised:
    """A service that is started again after it was killed."""

    name: str
    port: int
    arguments: tuple[str, ...]
    log: Path
    environment: dict[str, str]
    service: Service = field(init=False)
    starts: int = 0
    _stack: ExitStack = field(default_factory=ExitStack)
    _read: int = 0

    def start(self) -> None:
        """Raises StartError."""
        self.service: Service = self._stack.enter_context(
            started(self.name, *self.arguments, log=self.log, **self.environment)
        )
        self.service.wait_until_healthy(self.port)
        self.starts += 1

    def kill(self) -> None:
        """Kill it, as a crash would, and start it again. Raises StartError."""
        self.service.process.kill()
        self.stop()
        self.start()

    def stop(self) -> None:
        self._stack.close()

    def new_complaints(self) -> list[str]:
        """Lines of its log since the last call that look like errors."""
        text = self.log.read_text(errors="replace")
        new, self._read = text[self._read :], len(text)
        return [f"{self.name}: {line}" for line in new.splitlines() if COMPLAINT.search(line)]


class Soak:
    """The services, the page, and their samples."""

    def __init__(self, services: list[Supervised], page: Page, url: str, folder: Path) -> None:
        self.samples: list[Sample] = []
        self.complaints: list[str] = []
        self._services, self._page, self._url, self._folder = services, page, url, folder
        self._began, self._killed = time.monotonic(), 0.0
        page.on("console", self._hear)

    def run(self, seconds: float, kill_every_s: float) -> None:
        next_kill, victims = kill_every_s, itertools.cycle(self._services)
        for scene, mode in itertools.cycle(itertools.product(SCENES, MODES)):
            if (elapsed := time.monotonic() - self._began) > seconds:
                return
            if elapsed > next_kill:
                victim, next_kill = next(victims), next_kill + kill_every_s
                self._killed = time.monotonic()
                victim.kill()
                print(f"{elapsed / 60:5.1f} min: killed {victim.name}", flush=True)
            self._walk(scene, mode)
            self._sample()
            if (scene, mode) == (SCENES[-1], MODES[-1]):
                self._add_and_delete()
                self._experiment()

    def _walk(self, scene: str, mode: str) -> None:
        """Walk in a mode, which has to show frames."""
        self._page.goto(f"{self._url}/#/")
        self._page.locator(".stage").wait_for(state="detached")
        self._page.goto(f"{self._url}/#/scene/{scene}")
        self._page.wait_for_function("mode => window.tigas && (tigas.settings({ mode }), true)", arg=mode)
        try:
            self._page.wait_for_function("() => window.tigas?.state().ready", timeout=RECOVERY_S * 1000)
        except TimeoutError:
            minute = (time.monotonic() - self._began) / 60
            said = " ".join(self._page.locator(".stage-area").inner_text().split())
            self.complaints.append(f"{minute:.1f} min: {mode} in {scene} showed nothing; the page says: {said}")
            return
        end = time.monotonic() + STEP_S
        for key in itertools.cycle(KEYS):
            if time.monotonic() > end:
                break
            self._page.keyboard.press(key, delay=250)

    def _add_and_delete(self) -> None:
        self._page.goto(self._url)
        with self._page.expect_file_chooser() as chooser:
            self._page.get_by_role("button", name="Add scenes").click()
        chooser.value.set_files(self._folder / "added.ply")
        thumbnail = "() => document.querySelector('[data-scene=added] img')?.naturalWidth > 0"
        self._page.wait_for_function(thumbnail, timeout=RECOVERY_S * 1000)
        httpx.delete(f"{self._url}/scenes/added", trust_env=False).raise_for_status()

    def _experiment(self) -> None:
        """A run of another browser, which the command starts."""
        file = self._folder / "soak.toml"
        file.write_text(EXPERIMENT)
        out = self._folder / "experiments" / str(len(self.samples))
        command = tigas_command("experiment", "run", str(file), "--url", self._url, "--out", str(out))
        ended = subprocess.run(command, capture_output=True, text=True, timeout=EXPERIMENT_S)
        if ended.returncode:
            self._complain([f"experiment: {line}" for line in ended.stderr.splitlines()[-2:]])

    def _sample(self) -> None:
        at = time.monotonic() - self._began
        for one in self._services:
            if not one.service.runs:
                raise StartError(f"tigas {one.name} ended unasked; see {one.log}.")
            self.samples.append(Sample(at, one.name, one.starts, one.service.megabytes, one.service.open_files))
            self._complain(one.new_complaints())
        browser = next(child.pid for child in psutil.Process().children(recursive=True) if _is_browser(child))
        self.samples.append(Sample(at, "browser", 1, megabytes_of(browser), open_files_of(browser)))

    def _hear(self, message: ConsoleMessage) -> None:
        if message.type == "error":
            self._complain([f"page: {message.text} ({message.location['url']})"])

    def _complain(self, lines: list[str]) -> None:
        if time.monotonic() - self._killed > RECOVERY_S:
            self.complaints += lines


def _is_browser(process: psutil.Process) -> bool:
    """Whether it is Chromium's main process, which starts all others."""
    with suppress(psutil.NoSuchProcess):
        arguments = process.cmdline()
        return "--headless=new" in arguments and not any(one.startswith("--type=") for one in arguments)
    return False


class Change(NamedTuple):
    """A process's figures after it settled and before it ended."""

    process: str
    start: int
    minutes: float
    before: tuple[float, float]
    after: tuple[float, float]

    @property
    def flat(self) -> bool:
        (memory, files), (later, more) = self.before, self.after
        return later - memory <= max(GROWTH_MB, GROWTH * memory) and more - files <= GROWTH_FILES


def changes(samples: list[Sample]) -> list[Change]:
    """Changes of each process that ran long enough: medians of a quarter of its samples, over all modes."""
    found = []
    ordered = sorted(samples, key=lambda one: (one.process, one.start, one.at_s))
    for (name, start), group in itertools.groupby(ordered, lambda one: (one.process, one.start)):
        run = list(group)
        settled = [one for one in run if one.at_s - run[0].at_s >= SETTLE_S]
        quarter = len(settled) // 4
        if quarter:
            ends = [
                (median(one.megabytes for one in part), median(one.files for one in part))
                for part in (settled[:quarter], settled[-quarter:])
            ]
            found.append(Change(name, start, (settled[-1].at_s - settled[0].at_s) / 60, ends[0], ends[1]))
    return found


def report(samples: list[Sample], out: Path) -> bool:
    """Write the samples and their plot, and print the changes; whether all processes are flat."""
    with (out / "soak.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(Sample._fields)
        writer.writerows(samples)
    with plot_style():
        figure, panels = panel_grid(2)
        for name in dict.fromkeys(one.process for one in samples):
            mine = [one for one in samples if one.process == name]
            minutes = [one.at_s / 60 for one in mine]
            panels[0].plot(minutes, [one.megabytes for one in mine], label=name)
            panels[1].plot(minutes, [one.files for one in mine], label=name)
        for panel, title in zip(panels, ("Resident memory, MB", "Open files"), strict=True):
            panel.set_title(title)
            panel.set_xlabel("Minutes")
            panel.set_ylim(bottom=0)
        add_legend(figure, panels)
        (out / "soak.svg").write_text(svg(figure))
    table = Table("process", "start", "minutes", "MB", "later", "open files", "later", "flat", box=SIMPLE_HEAD)
    found = changes(samples)
    for one in found:
        (memory, files), (later, more) = one.before, one.after
        cells = (f"{memory:.0f}", f"{later:.0f}", f"{files:.0f}", f"{more:.0f}", "yes" if one.flat else "no")
        table.add_row(one.process, str(one.start), f"{one.minutes:.0f}", *cells)
    make_console().print(table)
    return bool(found) and all(one.flat for one in found)


@contextmanager
def services(folder: Path, device: str) -> Iterator[tuple[list[Supervised], str]]:
    """The services on loopback, and the viewer's URL."""
    write_scene(folder / "models" / "ball" / "ball.ply")
    write_scene(folder / "added.ply")
    quic, render, dash, store = free_ports(socket.SOCK_DGRAM, *[socket.SOCK_STREAM] * 3)
    url = f"http://localhost:{render}"
    known = {"dash": f"http://localhost:{dash}", "store": f"http://localhost:{store}"}
    environment = {
        "TIGAS_RENDER_SERVICES": json.dumps(known),
        "TIGAS_DASH_ENCODER": "libx264",
        "TIGAS_DASH_ALLOW_ORIGINS": json.dumps([url]),
        "TIGAS_STORE_ALLOW_ORIGINS": json.dumps([url]),
        "TIGAS_STORE_RENDER": url,
    }
    quic_address, models = f"localhost:{quic}", str(folder / "models")
    arguments = {
        "render": ("--scenes", models, "--device", device, "--quic", quic_address),
        "dash": ("--render", url),
        "store": ("--results", str(folder / "results")),
    }
    running = [
        Supervised(name, port, (*arguments[name], "--http", f"localhost:{port}"), folder / f"{name}.log", environment)
        for name, port in {"render": render, "dash": dash, "store": store}.items()
    ]
    with ExitStack() as stack:
        for one in running:
            stack.callback(one.stop)
            one.start()
        yield running, url


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=120)
    parser.add_argument("--kill-every", type=float, default=10, help="minutes")
    parser.add_argument("--device", default="cpu", help="of the render service")
    parser.add_argument("--out", type=Path, default=Path("results/soak"))
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(prefix="tigas-soak-") as temporary, sync_playwright() as playwright:
        folder = Path(temporary)
        browser = playwright.chromium.launch(executable_path=find_chromium(), args=[*ARGUMENTS, "--no-sandbox"])
        with services(folder, options.device) as (running, url):
            page = browser.new_page(viewport={"width": 640, "height": 360})
            soak = Soak(running, page, url, folder)
            try:
                soak.run(options.minutes * 60, options.kill_every * 60)
            except (StartError, Error, httpx.HTTPError, psutil.Error, subprocess.TimeoutExpired) as error:
                soak.complaints.append(f"It ended early: {error}")
            browser.close()
            flat = report(soak.samples, options.out)
    for line in soak.complaints:
        print(line)
    return 0 if flat and not soak.complaints else 1


if __name__ == "__main__":
    sys.exit(main())
