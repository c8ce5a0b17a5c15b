"""Previews: the scene's own if valid, else one rendered once and kept."""

from __future__ import annotations

import asyncio
import gc
import io
import math
from dataclasses import dataclass, field, replace
from pathlib import Path

import pytest
from PIL import Image

from tests.render.scenes import plys
from tigas_common.errors import BrokenScene
from tigas_common.wire.render import StartCamera
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

    calls: list[tuple[str, int, int]] = field(default_factory=list)
    gate: asyncio.Event = field(default_factory=asyncio.Event)
    error: Exception | None = None

    async def __call__(self, scene_id: str, width: int, height: int) -> bytes:
        self.calls.append((scene_id, width, height))
        await self.gate.wait()
        if self.error:
            raise self.error
        return image(size=(width, height))


@pytest.fixture
def renderer() -> Renderer:
    renderer = Renderer()
    renderer.gate.set()
    return renderer


async def test_a_missing_preview_is_rendered_once_and_kept(tmp_path: Path, renderer: Renderer) -> None:
    cache = PreviewCache(tmp_path / "deep" / "cache", renderer)
    first = await cache.get(SOURCE)
    assert Image.open(io.BytesIO(first.body)).size == (640, 360)
    assert first.media_type == "image/jpeg"
    assert await cache.get(SOURCE) == first
    assert await PreviewCache(tmp_path / "deep" / "cache", renderer).get(SOURCE) == first  # also after a restart
    assert renderer.calls == [("garden", 640, 360)]
    assert len(list((tmp_path / "deep" / "cache").iterdir())) == 1  # and temporary files are removed


async def test_another_scene_version_or_camera_gets_another_picture(tmp_path: Path, renderer: Renderer) -> None:
    cache = PreviewCache(tmp_path, renderer)
    for source in (
        SOURCE,
        replace(SOURCE, id="forest"),
        replace(SOURCE, version="2"),
        replace(SOURCE, metadata=SceneMetadata(background=(1, 0, 0))),
    ):
        await cache.get(source)
    assert len(renderer.calls) == 4


async def test_concurrent_first_requests_render_once_and_may_give_up(tmp_path: Path, renderer: Renderer) -> None:
    renderer.gate.clear()
    cache = PreviewCache(tmp_path, renderer)
    tasks = [asyncio.create_task(cache.get(SOURCE)) for _ in range(4)]
    while not renderer.calls:  # noqa: ASYNC110 - the renderer runs in this event loop
        await asyncio.sleep(0)
    tasks[0].cancel()
    renderer.gate.set()
    outcomes = await asyncio.gather(*tasks, return_exceptions=True)
    assert isinstance(outcomes[0], asyncio.CancelledError)
    assert all(isinstance(outcome, Preview) for outcome in outcomes[1:])
    assert len(renderer.calls) == 1


@pytest.mark.parametrize("content", [b"", b"no picture", image()[:200], image()[:-40], image("GIF")])
async def test_a_corrupt_entry_is_rendered_again(tmp_path: Path, renderer: Renderer, content: bytes) -> None:
    cache = PreviewCache(tmp_path, renderer)
    good = await cache.get(SOURCE)
    (entry,) = tmp_path.iterdir()  # noqa: ASYNC240 - a test may block
    entry.write_bytes(content)
    assert await cache.get(SOURCE) == good
    assert entry.read_bytes() == good.body
    assert len(renderer.calls) == 2


async def test_a_failure_that_nobody_waits_for_is_no_surprise(
    tmp_path: Path, renderer: Renderer, caplog: pytest.LogCaptureFixture
) -> None:
    renderer.gate.clear()
    renderer.error = BrokenScene("It is torn.")
    cache = PreviewCache(tmp_path, renderer)
    asked = asyncio.create_task(cache.get(SOURCE))
    while not renderer.calls:  # noqa: ASYNC110 - the renderer runs in this event loop
        await asyncio.sleep(0)
    asked.cancel()
    renderer.gate.set()
    while cache._rendering:  # noqa: ASYNC110 - as above
        await asyncio.sleep(0)
    gc.collect()
    assert "never retrieved" not in caplog.text


async def test_a_failure_is_passed_on_and_not_kept(tmp_path: Path, renderer: Renderer) -> None:
    renderer.error = BrokenScene("It is torn.")
    cache = PreviewCache(tmp_path, renderer)
    for _ in range(2):
        with pytest.raises(BrokenScene, match="torn"):
            await cache.get(SOURCE)
    renderer.error = None
    await cache.get(SOURCE)
    assert len(renderer.calls) == 3


async def test_a_cache_that_cannot_be_written_is_no_failure(
    tmp_path: Path, renderer: Renderer, caplog: pytest.LogCaptureFixture
) -> None:
    cache = PreviewCache(plys.write(tmp_path / "file", b"") / "cache", renderer)
    assert (await cache.get(SOURCE)).body
    assert "cannot be written" in caplog.text


@pytest.mark.parametrize(("name", "format"), [("preview.jpg", "JPEG"), ("preview.png", "PNG"), ("preview.jpg", "PNG")])
async def test_a_scene_may_bring_its_own(tmp_path: Path, renderer: Renderer, name: str, format: str) -> None:
    content = image(format)
    source = replace(SOURCE, preview=plys.write(tmp_path / name, content))
    preview = await PreviewCache(tmp_path / "cache", renderer).get(source)
    assert preview.body == content
    assert preview.media_type == f"image/{format.lower()}"  # detected by content, not by name
    assert renderer.calls == []


@pytest.mark.parametrize(
    "content",
    [b"<svg onload=alert(1)>", image("GIF"), image() + bytes(MAX_BYTES), image("PNG", size=(20_000, 20_000))],
    ids=["another type", "GIF", "too large", "too many pixels"],
)
async def test_a_bad_one_is_replaced(
    tmp_path: Path, renderer: Renderer, content: bytes, caplog: pytest.LogCaptureFixture
) -> None:
    source = replace(SOURCE, preview=plys.write(tmp_path / "preview.jpg", content))
    preview = await PreviewCache(tmp_path / "cache", renderer).get(source)
    assert Image.open(io.BytesIO(preview.body)).size == (640, 360)
    assert "another is rendered" in caplog.text


async def test_a_missing_file_is_no_preview(tmp_path: Path) -> None:
    assert read_preview(tmp_path / "nowhere.jpg") is None
    assert read_preview(tmp_path) is None


async def test_the_camera_has_square_pixels_and_sixty_degrees() -> None:
    start = StartCamera(position=(1, 2, 3), look_at=(1, 2, 9))
    camera = preview_camera(start, (0, -1, 0), 640, 360)
    lens = camera.intrinsics
    assert camera.pose.position == (1, 2, 3)
    assert camera.pose.rotation == ((1, 0, 0), (0, 1, 0), (0, 0, 1))
    assert lens.fx == lens.fy
    assert math.degrees(2 * math.atan(lens.height / 2 / lens.fy)) == pytest.approx(60)
