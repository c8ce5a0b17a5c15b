"""Kept start views: read again as written, and not for another file or up axis."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from tigas_common.wire.render import StartCamera
from tigas_render.scenes.source import SceneMetadata, SceneSource
from tigas_render.scenes.start_view.kept import KeptViews
from tigas_render.scenes.start_view.view import StartView

SOURCE = SceneSource("garden", SceneMetadata(), "1", None)
VIEW = StartView(up=(0, 0, 1), camera=StartCamera(position=(1, 2, 3), look_at=(0, 0, 0)))


def test_a_view_is_kept_for_its_file_and_its_up_axis(tmp_path: Path) -> None:
    views = KeptViews(tmp_path / "cache")
    assert views.read(SOURCE) is None
    views.write(SOURCE, VIEW)
    assert KeptViews(tmp_path / "cache").read(SOURCE) == VIEW
    assert views.read(replace(SOURCE, metadata=SceneMetadata(name="Another"))) == VIEW
    assert views.read(replace(SOURCE, version="2")) is None
    assert views.read(replace(SOURCE, metadata=SceneMetadata(up=(0, 1, 0)))) is None


def test_a_broken_file_is_no_view(tmp_path: Path) -> None:
    views = KeptViews(tmp_path)
    views.write(SOURCE, VIEW)
    for path in tmp_path.iterdir():
        path.write_text('{"up": [0, 0, 1]}')
    assert views.read(SOURCE) is None


def test_a_directory_that_cannot_be_made_keeps_nothing(tmp_path: Path) -> None:
    (tmp_path / "cache").write_text("a file")
    views = KeptViews(tmp_path / "cache")
    views.write(SOURCE, VIEW)
    assert views.read(SOURCE) is None
