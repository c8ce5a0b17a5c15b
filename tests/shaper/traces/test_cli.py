"""The commands `tigas trace …`, as a user runs them."""

from __future__ import annotations

import hashlib
import threading
import xml.etree.ElementTree as ElementTree
import zipfile
from collections.abc import Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest
from PIL import Image

from tests.command import Result, tigas
from tigas_common.wire.shaper import LinkSetting
from tigas_shaper.traces.fetch import load_sources
from tigas_shaper.traces.formats import load_trace

OWN = Path(__file__).parents[3] / "traces" / "network"


def run(*arguments: str | Path) -> Result:
    return tigas("trace", *arguments)


def test_import_writes_our_csv_combines_two_directions_and_adds_losses(tmp_path: Path) -> None:
    down, up, out = tmp_path / "x.down", tmp_path / "x.up", tmp_path / "x.csv"
    down.write_text("5000\n4000\n")
    up.write_text("1000\n")
    assert run("import", down, out, "--up", up, "--loss-pct", "1").exit_code == 0
    assert load_trace(out).states == (LinkSetting(5000, 1000, loss_pct=1), LinkSetting(4000, 1000, loss_pct=1))


def test_import_does_not_replace_a_file(tmp_path: Path) -> None:
    recording, out = tmp_path / "r.txt", tmp_path / "r.csv"
    recording.write_text("5000\n")
    out.write_text("mine")
    result = run("import", recording, out)
    assert (result.exit_code, out.read_text()) == (1, "mine")
    assert "exists; remove it first" in result.output
    out.unlink()
    assert run("import", recording, out, "--up-kbps", "7").exit_code == 0
    assert load_trace(out).states[0].up_kbps == 7


@pytest.mark.parametrize("arguments", [("import",), ("info",), ("info", "--plot")])
def test_a_broken_file_is_named_with_one_sentence(arguments: tuple[str, ...], tmp_path: Path) -> None:
    broken = tmp_path / "broken.txt"
    broken.write_text("5000\nfast\n")
    out = tmp_path / "out.png"
    command, *option = arguments
    result = run(command, broken, *option, *([] if arguments == ("info",) else [out]))
    assert result.exit_code == 1
    assert f"{broken}: Line 2: each line of this file must be a number, not 'fast'." in result.output
    assert not out.exists()
    assert run("info", tmp_path / "absent").exit_code == 1
    assert "Unknown format 'x'" in run("import", broken, "--format", "x").output


def test_info_prints_duration_rates_and_outages() -> None:
    output = run("info", OWN / "outage.csv").output
    assert "60 s in 5 steps" in output
    assert "2, together 6 s, the longest 5 s" in output
    assert "down  18.00  0.00  0.00  20.00" in " ".join(output.split()).replace(" ", "  ")


def test_plot_draws_the_trace(tmp_path: Path) -> None:
    png, svg = tmp_path / "t.png", tmp_path / "t.svg"
    assert run("info", OWN / "dsl.csv", "--plot", png).exit_code == 0
    with Image.open(png) as picture:
        assert picture.width > 1000
        assert len(picture.convert("RGB").getcolors(1 << 24) or ()) > 20
    assert run("info", OWN / "outage.csv", "--plot", svg).exit_code == 0
    assert ElementTree.parse(svg).getroot().tag.endswith("svg")
    result = run("info", OWN / "dsl.csv", "--plot", tmp_path / "t.exe")
    assert (result.exit_code, "must end in .png, .svg or .pdf" in result.output) == (1, True)


@pytest.fixture
def published(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The only set that is known: a zip with a checksum and a log without, served from here."""
    files = tmp_path / "served"
    files.mkdir()
    with zipfile.ZipFile(files / "logs.zip", "w") as archive:
        archive.writestr("a.txt", "5000\n")
    (files / "b.txt").write_text("5000\n")
    digest = hashlib.sha256((files / "logs.zip").read_bytes()).hexdigest()

    class Quiet(SimpleHTTPRequestHandler):
        def log_message(self, *_: object) -> None:
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(files))) as http:
        thread = threading.Thread(target=http.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        base = f"http://127.0.0.1:{http.server_port}"
        sources = tmp_path / "sources.toml"
        sources.write_text(
            f'[mine]\ntitle = "My set"\npage = "p"\nlicence = "CC0"\ncite = "Me 2024"\n'
            f'files = [{{ url = "{base}/logs.zip", sha256 = "{digest}" }}, {{ url = "{base}/b.txt" }}]\n'
        )
        monkeypatch.setattr("tigas_shaper.traces.fetch.load_sources", partial(load_sources, sources))
        monkeypatch.chdir(tmp_path)
        yield
        http.shutdown()
        thread.join()


@pytest.mark.usefixtures("published")
def test_fetch_lists_downloads_unpacks_and_says_what_was_not_checked(tmp_path: Path) -> None:
    assert "mine: My set" in run("fetch").output
    result = run("fetch", "mine")
    assert result.exit_code == 0, result.output
    assert load_trace(tmp_path / "traces/fetched/mine" / "logs" / "a.txt").mean_down_kbps == 5000
    assert "cite: Me 2024" in result.output
    assert "b.txt: no known checksum" in result.output
    assert "logs.zip: no known checksum" not in result.output
    result = run("fetch", "../x")
    assert result.exit_code == 1
    assert "Unknown trace set '../x': choose one of mine." in result.output
