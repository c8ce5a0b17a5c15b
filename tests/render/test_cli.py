"""The commands from a user's point of view: output, failures, and shutdown."""

from __future__ import annotations

import asyncio
import contextlib
import os
import re
import signal
import socket
import ssl
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import httpx
import pytest

import tigas_render
from tests.command import tigas
from tests.render import losing_device
from tests.render.fakes import render_request
from tests.render.scenes import plys
from tests.render.transport.client import connect
from tigas_common.processes import STOP_S
from tigas_render.settings import RenderSettings

ROOT = Path(__file__).parents[2]
COURTYARD = Path(tigas_render.__file__).parent / "scenes/demo/courtyard.sog"
TIGAS = str(Path(sys.executable).parent / "tigas")
INSTANT = ("--device", "instant", "--edges", "1")
"""Starts at once, and renders nothing."""


@contextlib.contextmanager
def serving(
    *arguments: str, program: Sequence[str] = (TIGAS,), cwd: Path = ROOT
) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """A server on free ports and its output until it was ready."""
    command = [*program, "render", "--http", "127.0.0.1:0", "--quic", "127.0.0.1:0", *arguments]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, cwd=cwd) as process:
        try:
            assert process.stdout is not None
            printed = ""
            for line in process.stdout:
                printed += line
                if line.startswith("Open "):
                    break
            else:
                pytest.fail(f"the server did not start:\n{printed}")
            yield process, printed
        finally:
            if process.poll() is None:
                process.send_signal(signal.SIGTERM)
                process.wait(10)


def url_in(printed: str) -> str:
    match = re.search(r"Open (http://\S+/)", printed)
    assert match
    return match[1]


def config_of(printed: str, host: str = "localhost") -> dict[str, Any]:
    config: dict[str, Any] = httpx.get(url_in(printed) + "config.json", headers={"Host": host}).json()
    return config


def scenes_of(printed: str) -> list[str]:
    return [scene["id"] for scene in httpx.get(url_in(printed) + "scenes").json()]


@pytest.mark.slow
def test_the_server_says_what_it_serves_and_stops_at_once_when_told(tmp_path: Path) -> None:
    (tmp_path / "torn").mkdir()
    (tmp_path / "torn" / "torn.ply").write_bytes(b"ply\nformat binary_little_endian 1.0\n")
    (tmp_path / "pipe").mkdir()
    (tmp_path / "pipe" / "pipe.ply").write_bytes(b"")
    os.mkfifo(tmp_path / "pipe" / "scene.json")
    with serving("--scenes", str(tmp_path), "--https", "127.0.0.1:0") as (process, printed):
        assert "torn is left out: torn.ply is truncated" in printed
        assert "pipe is left out: scene.json cannot be read: Not a regular file." in printed
        assert "1 scene ready on cpu." in printed
        for _ in range(8):
            assert httpx.get(url_in(printed) + "scenes?scan=1").status_code == 200
        config = config_of(printed)
        assert config["webtransport_url"].startswith("https://127.0.0.1:")
        context = ssl.create_default_context()
        context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
        https_url = config["https_url"].replace("localhost", "127.0.0.1")
        assert httpx.get(https_url + "healthz", verify=context).json() == {"status": "ok"}
        stopping = time.monotonic()
        process.send_signal(signal.SIGTERM)
        assert process.wait(20) == 0
        assert time.monotonic() - stopping < STOP_S, "others end it by force after that"


@pytest.mark.slow
def test_the_network_is_served_on_request(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("TIGAS_CONFIG", raising=False)
    local, lan = RenderSettings(), RenderSettings(lan=True)
    assert all(address.is_loopback for address in local.addresses)
    assert str(local.quic) == "localhost:4433"
    assert [str(address) for address in lan.addresses] == ["0.0.0.0:8080", "0.0.0.0:8443", "[::]:4433"]
    assert RenderSettings(lan=True, http="127.0.0.1:0").http.is_loopback  # type: ignore[arg-type]
    with serving("--scenes", str(tmp_path)) as (_, printed):
        assert "Open to the network" not in printed
        assert "has no scenes yet" in printed
        assert scenes_of(printed) == ["courtyard"], "the demo"
        assert config_of(printed)["webtransport_url"] is not None
        assert config_of(printed)["dash_h3_url"] is None, "there is no packager behind it"
        assert config_of(printed, "192.0.2.1")["webtransport_url"] is None, "that machine does not reach it"
    with serving("--scenes", str(tmp_path), "--quic", "[::]:0") as (_, printed):
        assert "Open to the network on [::]:0: any machine that reaches this one can use this service." in printed


@pytest.mark.slow
def test_pages_and_names_that_are_allowed_may_use_http_and_webtransport(tmp_path: Path) -> None:
    allowed = ("--allow-origin", "https://page.example", "--allow-host", "tigas.example")

    async def session(port: int, host: str, origin: str) -> str:
        async with connect(port, certificate=None) as client:
            opened = await client.connect_webtransport(authority=host, origin=origin)
            return str(client.responses[opened].status)

    with serving("--scenes", str(tmp_path), *allowed) as (_, printed):
        port = urlsplit(config_of(printed)["webtransport_url"]).port
        assert port is not None
        for host, origin, status in (
            ("localhost", "https://page.example", 200),
            ("tigas.example", "https://tigas.example", 200),
            ("localhost", "https://evil.example", 403),
            ("evil.example", "https://evil.example", 421),
        ):
            headers = {"Host": host, "Origin": origin}
            assert httpx.get(url_in(printed) + "config.json", headers=headers).status_code == status
            assert asyncio.run(session(port, host, origin)) == str(status)


@pytest.mark.slow
@pytest.mark.parametrize("how", ["lost", "stuck"])
def test_a_server_whose_gpu_fails_ends_so_that_another_can_be_started(how: str) -> None:
    """Even if a thread never returns from the GPU."""
    with serving(program=(sys.executable, "-m", losing_device.__name__, how)) as (process, printed):
        request = render_request(scene="courtyard").model_dump(mode="json", exclude_none=True)
        if how == "lost":
            answer = httpx.post(url_in(printed) + "render", json=request, timeout=60)
            assert (answer.status_code, answer.json()["detail"]) == (503, losing_device.REASON)
        else:
            with pytest.raises(httpx.TransportError):  # its connection breaks when the process ends
                httpx.post(url_in(printed) + "render", json=request, timeout=60)
        rest, _ = process.communicate(timeout=20)
    assert process.returncode == 1
    assert (losing_device.REASON if how == "lost" else "The renderer is stuck") in rest
    assert "Traceback" not in rest


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "folder"),
    [((), "models"), (("--scenes", "models"), "models"), (("--scenes", "mine", "--edit-scenes"), "mine")],
    ids=["by default", "named as the default", "to be filled by pages"],
)
def test_the_first_start_makes_the_directory_that_pages_add_scenes_to(
    tmp_path: Path, arguments: tuple[str, ...], folder: str
) -> None:
    with serving(*INSTANT, *arguments, cwd=tmp_path) as (_, printed):
        assert f"{folder} has no scenes yet" in printed
        assert config_of(printed)["max_upload_bytes"]
    assert [path.name for path in tmp_path.iterdir()] == [folder]


@pytest.mark.slow
def test_where_no_directory_can_be_made_the_demo_is_served() -> None:
    with serving(*INSTANT, cwd=Path("/proc")) as (_, printed):
        assert "has no scenes yet" not in printed
        assert scenes_of(printed) == ["courtyard"]
        assert config_of(printed)["max_upload_bytes"] is None


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("--scenes", "/nowhere/at/all"), "does not exist"),
        (("--scenes", "/nowhere/at/all", "--edit-scenes"), "does not exist"),
        (("--scenes", __file__), "does not exist|not a directory"),
        (("--device", "cuda"), "without CUDA|no NVIDIA GPU|packages for GPUs are missing"),
        (("--device", "abacus"), "device"),
        (("--device", "cuda:٣"), "device"),
        (("--http", "8080"), "HOST:PORT"),
        (("--http", "127.0.0.1:٣"), "HOST:PORT"),
        (("--http", "192.0.2.1:0"), "Cannot listen on 192.0.2.1:0"),
        *((("--memory-gb", size), "--memory-gb") for size in ("-1", "0", "inf", "nan", "1e308")),
    ],
)
def test_a_server_that_cannot_start_says_why_in_a_sentence(arguments: tuple[str, ...], says: str) -> None:
    result = tigas("render", "--http", "127.0.0.1:0", "--quic", "off", *arguments)
    assert result.exit_code != 0
    assert re.search(says, " ".join(result.output.split()))
    assert "Traceback" not in result.output


@pytest.mark.parametrize("edges", ["1", "2"])
@pytest.mark.parametrize("flag", ["--http", "--https", "--quic"])
def test_a_port_that_is_taken_is_named(flag: str, edges: str) -> None:
    kind = socket.SOCK_DGRAM if flag == "--quic" else socket.SOCK_STREAM
    with socket.socket(socket.AF_INET, kind) as taken:
        taken.bind(("127.0.0.1", 0))
        if kind == socket.SOCK_STREAM:
            taken.listen()
        address = f"127.0.0.1:{taken.getsockname()[1]}"
        free = {"--http": "127.0.0.1:0", "--quic": "127.0.0.1:0"} | {flag: address}
        result = tigas("render", "--edges", edges, *(part for pair in free.items() for part in pair))
    assert (result.exit_code, result.stdout) == (1, ""), "it is said before anything that takes time"
    assert f"Cannot listen on {address} (Address already in use); choose another with {flag}." in result.stderr


def test_another_aioquic_is_named_before_anything_is_imported_from_it(tmp_path: Path) -> None:
    (tmp_path / "aioquic").mkdir()
    (tmp_path / "aioquic" / "__init__.py").write_text("raise ImportError('a private name is gone')")
    (tmp_path / "aioquic-1.8.0.dist-info").mkdir()
    (tmp_path / "aioquic-1.8.0.dist-info" / "METADATA").write_text("Name: aioquic\nVersion: 1.8.0\n")
    environment = os.environ | {"PYTHONPATH": f"{tmp_path}:{os.environ.get('PYTHONPATH', '')}"}
    result = subprocess.run([TIGAS, "render"], capture_output=True, text=True, timeout=60, env=environment, check=False)
    assert result.returncode == 1
    assert re.fullmatch(r"aioquic 1\.8\.0 is installed, but TIGAS needs aioquic>=1\.7,<1\.8: .*\.\n", result.stderr)


def test_scene_info(tmp_path: Path) -> None:
    printed = tigas("scene", "info", COURTYARD).stdout
    assert re.search(r"Gaussians\s+[12]\d\d,\d{3}", printed)
    assert "start camera" in printed
    plys.write(tmp_path / "scene.ply", plys.binary_ply())
    (tmp_path / "scene.json").write_text(
        '{"name": "The [bold] hall", "up": [0, 1, 0], "background": [0.1, 0.2, 0.3],'
        ' "camera": {"position": [1, 2, 3], "look_at": [4, 5, 6]}}'
    )
    printed = " ".join(tigas("scene", "info", tmp_path).stdout.split())
    assert "name The [bold] hall format" in printed
    assert "start camera (1.00, 2.00, 3.00) → (4.00, 5.00, 6.00)" in printed
    assert "up (0.00, 1.00, 0.00) background (0.10, 0.20, 0.30)" in printed
    (tmp_path / "scene.json").write_text('{"name": 5}')
    broken = tigas("scene", "info", tmp_path)
    assert broken.exit_code == 1
    assert broken.stderr.startswith("scene.json is not valid: name: ")
    assert broken.stderr.count("\n") == 1


@pytest.mark.parametrize(("name", "magic"), [("view.jpg", b"\xff\xd8"), ("view.png", b"\x89PNG")])
def test_scene_preview(tmp_path: Path, name: str, magic: bytes) -> None:
    result = tigas("scene", "preview", COURTYARD, tmp_path / name)
    assert result.exit_code == 0, result.stderr
    assert (tmp_path / name).read_bytes().startswith(magic)


@pytest.mark.parametrize("command", ["info", "preview"])
def test_a_file_that_is_no_scene_is_explained(command: str, tmp_path: Path) -> None:
    (tmp_path / "scene.ply").write_text("hello")
    target = [tmp_path / "view.jpg"] if command == "preview" else []
    for name in ("scene.ply", "missing.ply"):
        result = tigas("scene", command, tmp_path / name, *target)
        assert (result.exit_code, result.stderr.count("\n")) == (1, 1)
        assert name in result.stderr


def test_settings_come_from_file_and_environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tigas.toml").write_text('[render]\nquic = "off"\nhttp = "nonsense"\n')
    assert "HOST:PORT" in tigas("render").stderr
    monkeypatch.setenv("TIGAS_RENDER_HTTP", "192.0.2.1:0")
    assert "Cannot listen on 192.0.2.1:0" in tigas("render").stderr
