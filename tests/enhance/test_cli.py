"""`tigas enhance` against a render service that shows discs instead of a scene."""

from __future__ import annotations

import hashlib
import io
import json
import subprocess
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest
from PIL import Image

from tests.cluster.hosts import load
from tests.command import tigas as in_process
from tests.enhance.synthetic import HEIGHT, LOW, QUALITY, WIDTH, as_jpeg, view
from tests.enhance.test_pairs import scene
from tigas_common.processes import tigas_command
from tigas_common.weights import FILE, read_weights
from tigas_common.wire.render import RenderRequest, Rung

RUNGS = ((WIDTH, HEIGHT), *LOW.values())
LADDER = tuple(Rung(name=str(w), width=w, height=h, quality=QUALITY, expected_kb=1) for w, h in RUNGS)
CONFIG = load().config.model_copy(update={"ladder": LADDER})
DIGEST = "ab" * 32


class Discs(BaseHTTPRequestHandler):
    """Each pose has a picture of its own."""

    protocol_version = "HTTP/1.1"

    def do_GET(self) -> None:
        self._answer(200, CONFIG.model_dump_json().encode())

    def do_POST(self) -> None:
        body = self.rfile.read(int(self.headers.get("content-length", 0)))
        if self.path == "/scenes/garden/load":
            self._answer(200, scene(file_sha256=self.server.digest).model_dump_json().encode())  # type: ignore[attr-defined]
        elif self.path == "/render":
            request = RenderRequest.model_validate_json(body)
            pixels = view(int(hashlib.sha256(str(request.pose.position).encode()).hexdigest()[:8], 16))
            if request.profile is None:
                picture = io.BytesIO()
                Image.fromarray(pixels).save(picture, "PNG")
                self._answer(200, picture.getvalue())
            else:
                self._answer(200, as_jpeg(pixels, *RUNGS[request.profile]))
        else:
            detail = {"type": "tigas:unknown-scene", "title": "", "status": 404, "detail": "There is no such scene."}
            self._answer(404, json.dumps(detail).encode())

    def _answer(self, status: int, body: bytes) -> None:
        self.send_response(status)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *args: object) -> None:
        """Nothing."""


@pytest.fixture
def server() -> Iterator[ThreadingHTTPServer]:
    with ThreadingHTTPServer(("127.0.0.1", 0), Discs) as server:
        server.digest = DIGEST  # type: ignore[attr-defined]
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield server
        server.shutdown()
        thread.join()


@pytest.fixture
def options(server: ThreadingHTTPServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    (tmp_path / "garden").mkdir()
    monkeypatch.setenv("TIGAS_RENDER_SCENES", str(tmp_path))
    return ["--render", f"http://127.0.0.1:{server.server_port}", "--device", "cpu"]


def run(*arguments: str) -> tuple[int, str]:
    outcome = in_process("enhance", *arguments)
    return outcome.exit_code, outcome.output


@pytest.mark.extended
def test_networks_are_trained_and_evaluated(server: ThreadingHTTPServer, options: list[str], tmp_path: Path) -> None:
    file = tmp_path / "garden" / FILE
    status, said = run("train", "garden", *options, "--seconds", "1", "--out", str(file))
    assert status == 0, said
    weights = read_weights(file)
    assert weights.scene_sha256 == DIGEST
    assert weights.misfit(DIGEST, LADDER) is None
    assert [path.name for path in file.parent.iterdir()] == [FILE]

    status, said = run("evaluate", "garden", *options)
    assert status == 0, said
    assert all(f"{network.rung}  {network.width} × {network.height}" in said for network in weights.networks)
    server.digest = "cd" * 32  # type: ignore[attr-defined]
    status, said = run("evaluate", "garden", *options)
    assert status == 1
    assert "file has changed since these weights were trained" in said


@pytest.mark.slow
@pytest.mark.extended
def test_a_training_that_is_killed_leaves_the_weights_that_there_were(options: list[str], tmp_path: Path) -> None:
    file = tmp_path / "garden" / FILE
    file.write_bytes(b"the old ones")
    command = tigas_command("enhance", "train", "garden", *options, "--seconds", "600", "--json")
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            trains = any(json.loads(line)["stage"].startswith("training rung 1") for line in process.stdout)
        finally:
            process.kill()
    assert trains
    assert file.read_bytes() == b"the old ones"
    assert [path.name for path in file.parent.iterdir()] == [FILE]


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["train", "nowhere"], "has no folder 'nowhere'"),
        (["train", "../garden"], "has no folder"),
        (["train", "garden", "other", "--out", "x"], "--out needs a single set"),
        (["train", "nowhere", "--out", "out"], "There is no such scene."),
        (["train", "garden", "--device", "tpu:7"], "There is no device 'tpu:7'"),
        (["evaluate", "garden"], "No such file"),
    ],
)
def test_what_cannot_be_done_is_said_in_a_sentence(arguments: list[str], sentence: str, options: list[str]) -> None:
    status, said = run(arguments[0], *options, *arguments[1:])
    assert status == 1
    assert sentence in said.replace("\n", " ")


def test_a_service_that_is_away_is_a_sentence(tmp_path: Path) -> None:
    status, said = run("train", "garden", "--render", "http://127.0.0.1:9", "--out", str(tmp_path / "out"))
    assert status == 1
    assert "The render service at http://127.0.0.1:9 does not answer" in said
