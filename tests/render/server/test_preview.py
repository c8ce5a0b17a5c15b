"""Previews: the scene's own if valid, else one rendered once and kept."""

from __future__ import annotations

import asyncio
import gc
import io
import math
import struct
from dataclasses import dataclass, field, replace
from pathlib import Path

import pytest
from PIL import Image

from tests.eventually import eventually
from tests.render.scenes import plys
from tigas_common.errors import BrokenScene
from tigas_common.wire.render import SavedView, StartCamera
from tigas_render.scenes.source import SceneMetadata, SceneSource
from tigas_render.server.preview import MAX_BYTES, Preview, PreviewCache, preview_camera, read_preview

pytestmark = pytest.mark.anyio

SOURCE = SceneSource("garden", SceneMetadata(), "1", None)


def image(format: str = "JPEG", colour: str = "red", size: tuple[int, int] = (64, 36)) -> bytes:
    file = io.BytesIO()
    Image.new("RGB", size, colour).save(file, format)
    return file.getvalue()


@dataclass
class Renderer:
    """Renders a picture when the test lets it."""

    calls: list[str] = field(default_factory=list)
    gate: asyncio.Event = field(default_factory=asyncio.Event)
    error: Exception | None = None

    async def __call__(self, scene_id: str) -> bytes:
        self.calls.append(scene_id)
        await self.gate.wait()
        if self.error:
            raise self.error
        return image(size=(640, 360))


@pytest.fixture
def renderer() -> Renderer:
    renderer = Renderer()
    renderer.gate.set()
    return renderer


@pytest.fixture
def cache(tmp_path: Path, renderer: Renderer) -> PreviewCache:
    return PreviewCache(tmp_path / "deep" / "cache", renderer)


async def test_a_preview_is_rendered_once_and_kept(tmp_path: Path, renderer: Renderer, cache: PreviewCache) -> None:
    first = await cache.get(SOURCE)
    assert Image.open(io.BytesIO(first.body)).size == (640, 360)
    assert first.media_type == "image/jpeg"
    assert await cache.get(SOURCE) == first
    assert await PreviewCache(tmp_path / "deep" / "cache", renderer).get(SOURCE) == first  # also after a restart
    assert renderer.calls == ["garden"]
    assert len(list((tmp_path / "deep" / "cache").iterdir())) == 1  # and temporary files are removed


async def test_another_scene_version_or_camera_gets_another_picture_but_a_saved_view_does_not(
    renderer: Renderer, cache: PreviewCache
) -> None:
    turned = SceneMetadata(background=(1, 0, 0))
    saved = SceneMetadata(views={"Door": SavedView(position=(0, 0, 0), quaternion=(0, 0, 0, 1))})
    for changes in ({}, {"id": "forest"}, {"version": "2"}, {"metadata": turned}, {"metadata": saved}):
        await cache.get(replace(SOURCE, **changes))
    assert len(renderer.calls) == 4


async def test_concurrent_first_requests_render_once_and_may_give_up(renderer: Renderer, cache: PreviewCache) -> None:
    renderer.gate.clear()
    tasks = [asyncio.create_task(cache.get(SOURCE)) for _ in range(4)]
    await eventually(lambda: renderer.calls)
    tasks[0].cancel()
    renderer.gate.set()
    outcomes = await asyncio.gather(*tasks, return_exceptions=True)
    assert isinstance(outcomes[0], asyncio.CancelledError)
    assert all(isinstance(outcome, Preview) for outcome in outcomes[1:])
    assert len(renderer.calls) == 1


@pytest.mark.parametrize("content", [b"", b"no picture", image()[:200], image()[:-40], image("GIF")])
async def test_a_corrupt_entry_is_rendered_again(
    tmp_path: Path, renderer: Renderer, cache: PreviewCache, content: bytes
) -> None:
    good = await cache.get(SOURCE)
    (entry,) = (tmp_path / "deep" / "cache").iterdir()
    entry.write_bytes(content)
    assert await cache.get(SOURCE) == good
    assert entry.read_bytes() == good.body
    assert len(renderer.calls) == 2


async def test_a_failure_is_not_kept(renderer: Renderer, cache: PreviewCache, caplog: pytest.LogCaptureFixture) -> None:
    renderer.error = BrokenScene("It is torn.")
    for _ in range(2):
        with pytest.raises(BrokenScene, match="torn"):
            await cache.get(SOURCE)
    renderer.gate.clear()
    asked = asyncio.create_task(cache.get(SOURCE))
    await eventually(lambda: len(renderer.calls) == 3)
    asked.cancel()
    renderer.gate.set()
    await eventually(lambda: not cache._rendering)
    gc.collect()
    assert "never retrieved" not in caplog.text
    renderer.error = None
    await cache.get(SOURCE)
    assert len(renderer.calls) == 4


async def test_the_cache_need_not_be_writable(
    tmp_path: Path, renderer: Renderer, caplog: pytest.LogCaptureFixture
) -> None:
    cache = PreviewCache(plys.write(tmp_path / "file", b"") / "cache", renderer)
    assert (await cache.get(SOURCE)).body
    assert "cannot be written" in caplog.text


@pytest.mark.parametrize(("name", "format"), [("preview.jpg", "JPEG"), ("preview.png", "PNG"), ("preview.jpg", "PNG")])
async def test_a_scene_may_bring_its_own(
    tmp_path: Path, renderer: Renderer, cache: PreviewCache, name: str, format: str
) -> None:
    preview = await cache.get(replace(SOURCE, preview=plys.write(tmp_path / name, image(format))))
    assert preview.body == image(format)
    assert preview.media_type == f"image/{format.lower()}"  # detected by content, not by name
    assert renderer.calls == []


def vast() -> bytes:
    """A picture whose header promises 400 million pixels."""
    content = image()
    size = content.index(b"\xff\xc0") + 5  # of the frame (ITU-T T.81, B.2.2)
    return content[:size] + struct.pack(">HH", 20_000, 20_000) + content[size + 4 :]


@pytest.mark.parametrize(
    "content",
    [b"<svg onload=alert(1)>", image("GIF"), image() + bytes(MAX_BYTES), vast()],
    ids=["another type", "GIF", "too large", "too many pixels"],
)
async def test_a_bad_one_is_replaced(
    tmp_path: Path, cache: PreviewCache, content: bytes, caplog: pytest.LogCaptureFixture
) -> None:
    preview = await cache.get(replace(SOURCE, preview=plys.write(tmp_path / "preview.jpg", content)))
    assert Image.open(io.BytesIO(preview.body)).size == (640, 360)
    assert "a preview is rendered" in caplog.text


def test_a_missing_file_is_no_preview(tmp_path: Path) -> None:
    assert read_preview(tmp_path / "nowhere.jpg") is None
    assert read_preview(tmp_path) is None


def test_the_camera_has_square_pixels_and_sixty_degrees() -> None:
    camera = preview_camera(StartCamera(position=(1, 2, 3), look_at=(1, 2, 9)), (0, -1, 0), 640, 360)
    lens = camera.intrinsics
    assert camera.pose.position == (1, 2, 3)
    assert camera.pose.rotation == ((1, 0, 0), (0, 1, 0), (0, 0, 1))
    assert lens.fx == lens.fy
    assert math.degrees(2 * math.atan(lens.height / 2 / lens.fy)) == pytest.approx(60)
