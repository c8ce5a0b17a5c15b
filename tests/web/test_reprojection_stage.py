"""The page's warp shows what NumPy says a camera elsewhere would see, in a Chromium whose WebGL is SwiftShader."""

from __future__ import annotations

import base64
import io
import math
import struct
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from playwright.sync_api import Browser, Page

from tests.web.bundle import bundled, open_with
from tests.web.conftest import CHROMIUM, CHROMIUM_ARGS
from tigas_render.encode import depth_segment

WEBGL_ARGS = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader"]

Floats = NDArray[np.float64]
Pixels = NDArray[np.uint8]


@dataclass(frozen=True)
class View:
    """As `View` in web/src/reproject/view.ts; turns are in degrees: to the right, up, and clockwise."""

    position: tuple[float, float, float] = (0, 0, 0)
    turn: tuple[float, float, float] = (0, 0, 0)
    fx: float = 80
    fy: float = 80
    cx: float = 48
    cy: float = 27
    width: int = 96
    height: int = 54

    @property
    def quaternion(self) -> list[float]:
        """[x, y, z, w], camera to world."""
        (sa, sb, sc), (ca, cb, cc) = (f(np.radians(self.turn) / 2) for f in (np.sin, np.cos))
        about_y_x = np.array([ca * sb, sa * cb, -sa * sb, ca * cb])
        x, y, z, w = about_y_x
        return [x * cc + y * sc, y * cc - x * sc, z * cc + w * sc, w * cc - z * sc]

    @property
    def rotation(self) -> Floats:
        """[3, 3], camera to world."""
        a, b, c = np.radians(self.turn)
        yaw = np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])
        pitch = np.array([[1, 0, 0], [0, np.cos(b), -np.sin(b)], [0, np.sin(b), np.cos(b)]])
        roll = np.array([[np.cos(c), -np.sin(c), 0], [np.sin(c), np.cos(c), 0], [0, 0, 1]])
        rotation: Floats = yaw @ pitch @ roll
        return rotation

    @property
    def directions(self) -> Floats:
        """[height, width, 3] in the world, through the middle of each pixel, 1 long along the camera's axis."""
        y, x = np.mgrid[: self.height, : self.width] + 0.5
        rays = np.stack([(x - self.cx) / self.fx, (y - self.cy) / self.fy, np.ones_like(x)], axis=2)
        directions: Floats = rays @ self.rotation.T
        return directions

    def pixels_of(self, points: Floats) -> tuple[Floats, NDArray[np.bool_]]:
        """Where points [..., 3] of the world are seen, in pixels [..., 2], and whether they are in the picture."""
        x, y, z = np.moveaxis((points - np.array(self.position)) @ self.rotation, -1, 0)
        ahead = np.where(z > 0, z, np.nan)
        u, v = x / ahead * self.fx + self.cx, y / ahead * self.fy + self.cy
        return np.stack([u, v], axis=-1), (u > 0) & (v > 0) & (u < self.width) & (v < self.height)

    def with_margins(self, x: int, y: int) -> View:
        return replace(self, cx=self.cx + x, cy=self.cy + y, width=self.width + 2 * x, height=self.height + 2 * y)

    def scaled(self, by: int) -> View:
        lens = {name: getattr(self, name) * by for name in ("fx", "fy", "cx", "cy", "width", "height")}
        return replace(self, **lens)

    @property
    def message(self) -> dict[str, Any]:
        """For the page."""
        lens = {name: value for name, value in asdict(self).items() if name != "turn"}
        return lens | {"quaternion": self.quaternion}


HOME = View()
WIDE = HOME.with_margins(24, 14)


def colours(points: Floats) -> Pixels:
    """A smooth texture of everything there is: what is at these points, [..., 3] to [..., 3]."""
    x, y, z = np.moveaxis(points, -1, 0)
    waves = [np.sin(7 * x + 2 * y) * np.cos(5 * z), np.sin(6 * y + 3 * z), np.cos(6 * x - 5 * y + 2 * z)]
    return np.round(127.5 + 110 * np.stack(waves, axis=-1)).astype(np.uint8)


def far_away(view: View) -> Pixels:
    """A panorama that is infinitely far."""
    directions = view.directions
    return colours(directions / np.linalg.norm(directions, axis=2, keepdims=True))


def on_a_wall(view: View, at: float) -> Pixels:
    """A wall across the world's z axis."""
    directions, position = view.directions, np.array(view.position)
    reach = (at - position[2]) / directions[..., 2:]
    return colours((position + reach * directions) / at)


def on_a_sphere(view: View, radius: float) -> Pixels:
    """Seen from within one around the origin."""
    directions = view.directions / np.linalg.norm(view.directions, axis=2, keepdims=True)
    position = np.array(view.position)
    along = directions @ position
    reach = -along + np.sqrt(along**2 + radius**2 - position @ position)
    return colours((position + reach[..., None] * directions) / radius)


def noise(width: int, height: int) -> Pixels:
    return np.random.default_rng(width).integers(0, 256, (height, width, 3), dtype=np.uint8)


def flat_depth(inverse_depth: float, width: int = 23, height: int = 13) -> dict[str, Any]:
    return depth_of(np.full((height, width), inverse_depth), inverse_depth)


def depth_of(inverse_depths: Floats, nearest: float) -> dict[str, Any]:
    """[height, width], as the page has it."""
    height, width = inverse_depths.shape
    codes = np.round(255 * inverse_depths / nearest).astype(np.uint8)
    return {"width": width, "height": height, "nearest": nearest, "codes": base64.b64encode(codes.tobytes()).decode()}


def psnr(shown: Pixels, expected: Pixels, where: NDArray[np.bool_] | None = None) -> float:
    """In dB, over the pixels [height, width] that are asked about."""
    difference = shown[..., :3].astype(np.float64) - expected
    error = float(np.mean((difference if where is None else difference[where]) ** 2))
    return math.inf if error == 0 else 10 * math.log10(255**2 / error)


def encoded(picture: NDArray[np.uint8], kind: str, **options: Any) -> bytes:
    file = io.BytesIO()
    Image.fromarray(picture).save(file, kind, **options)
    return file.getvalue()


START = """async () => {
  const { Warp } = await import("/warp.js");
  window.bytes = (base64) => Uint8Array.from(atob(base64), (character) => character.charCodeAt(0));
  const text = (bytes) => btoa(Array.from(bytes, (byte) => String.fromCharCode(byte)).join(""));
  window.begin = (distance) => {
    window.warp?.dispose();
    window.canvas = document.createElement("canvas");
    window.heard = [];
    const told = { onLost: () => heard.push("lost"), onRestored: () => heard.push("restored") };
    window.warp = new Warp(canvas, { distance: distance ?? Infinity, ...told });
    return warp.working;
  };
  window.take = async (png, view, depth) => {
    const bitmap = await createImageBitmap(new Blob([bytes(png)]));
    warp.take(bitmap, view, depth && { ...depth, codes: bytes(depth.codes) });
    bitmap.close();
  };
  window.draw = async (view, width, height) => {
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    warp.draw(view);
    const picture = await createImageBitmap(canvas);
    const context = new OffscreenCanvas(width, height).getContext("2d");
    context.drawImage(picture, 0, 0);
    return text(context.getImageData(0, 0, width, height).data);
  };
}"""


class Stage:
    """The page's canvas, with a warp of its own."""

    def __init__(self, page: Page, distance: float | None) -> None:
        self.page = page
        assert page.evaluate("(distance) => begin(distance)", distance)

    def take(self, picture: Pixels, view: View, depth: dict[str, Any] | None = None) -> None:
        png = base64.b64encode(encoded(picture, "png")).decode()
        self.page.evaluate("([png, view, depth]) => take(png, view, depth)", [png, view.message, depth])

    def draw(self, view: View, *, enlarged: int = 1) -> Pixels:
        """[height, width, 4]."""
        width, height = view.width * enlarged, view.height * enlarged
        content = self.page.evaluate("(asked) => draw(...asked)", [view.message, width, height])
        return np.frombuffer(base64.b64decode(content), np.uint8).reshape(height, width, 4)


@pytest.fixture(scope="module")
def page(browser: Browser, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    """A page with WebGL and the warp."""
    modules = {
        name: bundled(f"src/reproject/{entry}.ts", tmp_path_factory.mktemp(name))
        for name, entry in (("warp", "warp"), ("depth", "decode-depth"))
    }
    with browser.browser_type.launch(executable_path=CHROMIUM, args=[*CHROMIUM_ARGS, *WEBGL_ARGS]) as chromium:
        page = chromium.new_page()
        open_with(page, **modules)
        page.evaluate(START)
        yield page


@pytest.fixture
def stage(page: Page) -> Iterator[Stage]:
    """Where all without depth is infinitely far."""
    yield Stage(page, None)
    errors = page.evaluate("() => { const gl = canvas.getContext('webgl2'); return gl.getError(); }")
    assert errors == 0, "WebGL complains"


@pytest.mark.parametrize("margins", [(0, 0), (24, 14)])
def test_at_rest_the_pixels_are_the_frame_s(stage: Stage, margins: tuple[int, int]) -> None:
    x, y = margins
    frame = noise(96 + 2 * x, 54 + 2 * y)
    stage.take(frame, HOME.with_margins(x, y), flat_depth(0.5))
    shown = stage.draw(HOME)
    assert np.array_equal(shown[..., :3], frame[y : y + 54, x : x + 96])
    assert (shown[..., 3] == 255).all()


def test_what_is_enlarged_is_as_sharp_as_bicubic_makes_it(stage: Stage) -> None:
    frame = noise(96, 54)
    stage.take(frame, HOME)
    expected = np.asarray(Image.fromarray(frame).resize((288, 162), Image.Resampling.BICUBIC), dtype=int)
    difference = np.abs(stage.draw(HOME, enlarged=3)[..., :3] - expected)[6:-6, 6:-6]
    assert np.quantile(difference, 0.99) <= 2


def test_a_slow_graphics_processor_draws_a_simpler_picture(stage: Stage) -> None:
    frame = noise(96, 54)
    stage.take(frame, HOME)
    bicubic = stage.draw(HOME, enlarged=2)
    stage.page.evaluate("""async () => {
      const context = canvas.getContext("webgl2");
      const ask = context.getQueryParameter.bind(context);
      context.getQueryParameter = (query, name) => (name === context.QUERY_RESULT ? 20e6 : ask(query, name));
    }""")
    for _ in range(30):
        stage.draw(HOME, enlarged=2)
    assert stage.page.evaluate("warp.gpuMs") == 20
    simple = stage.draw(HOME, enlarged=2)
    expected = np.asarray(Image.fromarray(frame).resize((192, 108), Image.Resampling.BILINEAR))
    assert psnr(simple, expected) > psnr(bicubic, expected) + 6


def test_what_shrinks_does_not_flicker(stage: Stage) -> None:
    fine = np.kron(np.indices((108, 192)).sum(axis=0) % 2, np.ones((1, 1)))
    stage.take(np.repeat((255 * fine).astype(np.uint8)[..., None], 3, axis=2), HOME.scaled(2))
    shown = stage.draw(replace(HOME, turn=(0.2, 0.1, 0)))[4:-4, 4:-4, :3].astype(int)
    assert np.abs(shown - 127).max() < 20


@pytest.mark.parametrize("turn", [(4, 0, 0), (0, -3, 0), (0, 0, 8), (-5, 2, 3)])
def test_a_turned_frame_is_the_view(stage: Stage, turn: tuple[float, float, float]) -> None:
    stage.take(far_away(WIDE), WIDE)
    view = replace(HOME, turn=turn)
    shown = stage.draw(view)
    assert psnr(shown, far_away(view)) > 45
    assert psnr(far_away(HOME), far_away(view)) < 25, "the turn should make a difference"
    assert (shown[..., 3] == 255).all()


def test_where_nothing_was_seen_the_canvas_is_transparent(stage: Stage) -> None:
    stage.take(far_away(HOME), HOME)
    view = replace(HOME, turn=(20, 5, 10))
    shown = stage.draw(view)
    _, known = HOME.pixels_of(view.directions)
    opaque = shown[..., 3] == 255
    assert 0.3 < known.mean() < 0.8
    assert (opaque == known).mean() > 0.98
    assert set(np.unique(shown[..., 3])) == {0, 255}
    assert not shown[shown[..., 3] == 0].any(), "premultiplied"
    assert psnr(shown, far_away(view), opaque & known) > 40, "up to the frame's edge, which does not smear"


def test_a_step_before_a_wall_is_seen_by_its_depth(stage: Stage) -> None:
    stage.take(on_a_wall(WIDE, 4), WIDE, flat_depth(1 / 4))
    for position in [(0.3, 0, 0), (0, -0.2, 0.3), (-0.2, 0.1, -0.4)]:
        view = replace(HOME, position=position, turn=(2, -1, 3))
        assert psnr(stage.draw(view), on_a_wall(view, 4)) > 40
        assert psnr(on_a_wall(HOME, 4), on_a_wall(view, 4)) < 25, "the step should make a difference"


def test_a_wall_that_slants_away_is_bent_smoothly(stage: Stage) -> None:
    """To a camera that is turned, the wall's inverse depth falls from side to side."""
    frame = replace(WIDE, turn=(30, 0, 0))
    coarse = replace(frame, fx=20, fy=20, cx=18, cy=41 / 4, width=36, height=20)
    ahead = coarse.directions[..., 2]
    stage.take(on_a_wall(frame, 4), frame, depth_of(ahead / 4, float(ahead.max() / 4)))
    view = replace(HOME, turn=(30, 0, 0), position=(0.15, 0.05, 0.1))
    assert psnr(stage.draw(view), on_a_wall(view, 4)) > 36


def test_what_is_near_hides_what_is_far(stage: Stage) -> None:
    """A near red half on the left, a far blue one on the right: a step to the left moves red over blue."""
    frame = np.zeros((54, 96, 3), np.uint8)
    frame[:, :48, 0], frame[:, 48:, 2] = 255, 255
    inverse_depths = np.where(np.arange(24) < 12, 1.0, 0.0)[None].repeat(13, axis=0)
    stage.take(frame, HOME, depth_of(inverse_depths, 1.0))
    shown = stage.draw(replace(HOME, position=(-0.25, 0, 0)))
    assert (shown[:, 24:62, 0] > 200).all(), "20 pixels to the right"
    assert (shown[:, 72:, 2] > 200).all()
    uncovered = stage.draw(replace(HOME, position=(0.25, 0, 0)))
    assert (uncovered[:, :24, 0] > 200).all()
    assert (uncovered[:, 50:, 2] > 200).all()
    assert (uncovered[:, :75, 3] == 255).all(), "what comes out from behind is stretched, no hole"


def test_what_is_infinitely_far_stays_where_it_is(stage: Stage) -> None:
    codes = np.zeros((13, 23))
    codes[0, 0] = 0.5
    stage.take(far_away(WIDE), WIDE, depth_of(codes, 0.5))
    assert psnr(stage.draw(replace(HOME, position=(3, -2, 1))), far_away(HOME)) > 45


def test_without_depth_all_is_on_a_sphere(page: Page) -> None:
    stage = Stage(page, 5)
    home = replace(HOME, fx=32, fy=32)
    wide = home.with_margins(40, 24)
    stage.take(on_a_sphere(wide, 5), wide)
    view = replace(home, position=(0.6, 0.2, -0.7), turn=(-3, 2, 0))
    assert psnr(stage.draw(view), on_a_sphere(view, 5)) > 37
    assert psnr(on_a_sphere(home, 5), on_a_sphere(view, 5)) < 25, "the step should make a difference"


def test_at_an_infinite_distance_steps_change_nothing(stage: Stage) -> None:
    stage.take(noise(96, 54), HOME)
    assert np.array_equal(stage.draw(replace(HOME, position=(1, 2, 3))), stage.draw(HOME))


def test_what_was_seen_before_fills_the_view(stage: Stage) -> None:
    for degrees in (0, 30):
        seen = replace(WIDE, turn=(degrees, 0, 0))
        stage.take(far_away(seen), seen)
        stage.draw(seen)
    view = replace(HOME, turn=(2, 0, 0))
    shown = stage.draw(view)
    _, newest = seen.pixels_of(view.directions)
    assert 0.2 < newest.mean() < 0.8
    assert (shown[..., 3] == 255).all()
    assert psnr(shown, far_away(view), ~newest) > 33
    assert psnr(shown, far_away(view), newest) > 40


@pytest.mark.parametrize(
    "turn", [(90, 0, 0), (180, 0, 0), (-90, 0, 0), (45, 0, 0), (0, 85, 0), (0, -85, 0), (150, 40, 70)]
)
def test_every_side_is_remembered(stage: Stage, turn: tuple[float, float, float]) -> None:
    seen, aside = replace(WIDE, turn=turn), replace(WIDE, turn=(turn[0] + 120, 0, 0))
    for view in (seen, aside):
        stage.take(far_away(view), view)
        stage.draw(view)
    view = replace(HOME, turn=turn)
    _, newest = aside.pixels_of(view.directions)
    assert psnr(stage.draw(view), far_away(view), ~newest) > 33


def test_newer_frames_replace_what_was_seen(stage: Stage) -> None:
    aside = replace(HOME, turn=(100, 0, 0))
    for value, view in ((50, WIDE), (200, HOME), (90, aside)):
        stage.take(np.full((view.height, view.width, 3), value, np.uint8), view)
        stage.draw(view)
    shown = stage.draw(WIDE)[..., 0]
    assert (shown[18:-18, 28:-28] == 200).all()
    assert (shown[:12] == 50).all()


def test_after_a_cut_nothing_from_before_is_seen(stage: Stage) -> None:
    stage.take(far_away(HOME), HOME)
    stage.draw(HOME)
    stage.page.evaluate("warp.forget()")
    assert not stage.draw(HOME).any()
    aside = replace(HOME, turn=(25, 0, 0))
    stage.take(far_away(aside), aside)
    _, known = aside.pixels_of(HOME.directions)
    assert ((stage.draw(HOME)[..., 3] == 255) == known).mean() > 0.98


@pytest.mark.parametrize(("walked", "filled"), [(0.8, True), (1.2, False)])
def test_what_was_seen_is_dropped_after_a_quarter_of_the_distance(page: Page, walked: float, filled: bool) -> None:
    stage = Stage(page, 4)
    back = replace(HOME, turn=(180, 0, 0))
    stage.take(far_away(back), back)
    stage.draw(back)
    ahead = replace(HOME, position=(0, 0, walked))
    stage.take(far_away(ahead), ahead)
    assert (stage.draw(replace(ahead, turn=(180, 0, 0)))[..., 3] == 255).all() == filled


def test_frames_of_all_sizes_follow_each_other(stage: Stage) -> None:
    """Rungs, overscan and the canvas change; the view does not."""
    for scale, (x, y), enlarged in [(1, (0, 0), 2), (2, (10, 6), 1), (1, (24, 14), 1), (1, (3, 3), 2)]:
        frame = HOME.with_margins(x, y).scaled(scale)
        stage.take(far_away(frame), frame, flat_depth(0.5, 20 + x, 10 + y))
        shown = stage.draw(HOME, enlarged=enlarged)
        assert psnr(shown, far_away(HOME.scaled(enlarged))) > 38


def test_a_phone_that_is_turned_shows_the_frames_that_are_there(stage: Stage) -> None:
    stage.take(far_away(WIDE), WIDE)
    upright = replace(HOME, width=54, height=96, cx=27, cy=48)
    shown = stage.draw(upright)
    assert psnr(shown, far_away(upright), shown[..., 3] == 255) > 45
    assert (shown[10:-10, :, 3] == 255).all()


def test_a_lost_context_is_told_of_and_comes_back(page: Page) -> None:
    stage = Stage(page, None)
    stage.take(far_away(HOME), HOME)
    stage.draw(HOME)
    page.evaluate("() => (window.lose = canvas.getContext('webgl2').getExtension('WEBGL_lose_context')).loseContext()")
    page.wait_for_function("() => heard.includes('lost')")
    assert not page.evaluate("warp.working")
    stage.take(far_away(HOME), HOME)  # harmless
    assert not stage.draw(HOME).any()
    page.evaluate("warp.forget()")
    page.evaluate("lose.restoreContext()")
    page.wait_for_function("() => heard.includes('restored')")
    assert page.evaluate("warp.working")
    assert not stage.draw(HOME).any(), "the frame was lost, too"
    for degrees in (0, 30):
        seen = replace(WIDE, turn=(degrees, 0, 0))
        stage.take(far_away(seen), seen, flat_depth(0.1))
        stage.draw(seen)
    view = replace(HOME, turn=(2, 0, 0))
    assert psnr(stage.draw(view), far_away(view)) > 33


def test_a_warp_that_is_disposed_of_leaves_its_context_to_others(page: Page) -> None:
    complaints: list[str] = []
    page.on("console", lambda message: complaints.append(message.text))
    for _ in range(20):
        stage = Stage(page, None)
        stage.take(far_away(HOME), HOME)
        stage.draw(HOME)
    assert page.evaluate("heard") == []
    assert [complaint for complaint in complaints if "ReadPixels" not in complaint] == []


def test_a_video_is_turned_like_any_picture(page: Page) -> None:
    stage = Stage(page, None)
    playing = """async (png) => {
      const bitmap = await createImageBitmap(new Blob([bytes(png)]));
      const source = Object.assign(document.createElement("canvas"), { width: bitmap.width, height: bitmap.height });
      window.video = Object.assign(document.createElement("video"), { muted: true });
      warp.take(video, view, null); // it has no picture yet
      const context = source.getContext("2d");
      context.drawImage(bitmap, 0, 0);
      video.srcObject = source.captureStream();
      const shown = new Promise((resolve) => video.requestVideoFrameCallback(resolve));
      await video.play();
      context.drawImage(bitmap, 0, 0);
      await shown;
      warp.take(video, view, null);
    }"""
    stage.page.evaluate(f"(view) => {{ window.view = view; window.play = {playing}; }}", WIDE.message)
    stage.page.evaluate("(png) => play(png)", base64.b64encode(encoded(far_away(WIDE), "png")).decode())
    view = replace(HOME, turn=(4, 1, 2))
    assert psnr(stage.draw(view), far_away(view)) > 30


def test_without_webgl_there_is_no_warp(page: Page) -> None:
    """As where a canvas already has another context."""
    working = page.evaluate("""async () => {
      const { Warp } = await import("/warp.js");
      const canvas = document.createElement("canvas");
      canvas.getContext("2d");
      const warp = new Warp(canvas, { distance: 1 });
      const view = { position: [0, 0, 0], quaternion: [0, 0, 0, 1], fx: 1, fy: 1, cx: 1, cy: 1, width: 2, height: 2 };
      warp.take(new ImageData(2, 2), view, null);
      warp.draw(view);
      warp.forget();
      warp.dispose();
      return warp.working;
    }""")
    assert working is False


def with_depth(jpeg: bytes, nearest: float, image: bytes) -> bytes:
    content = b"tigas:depth\0" + struct.pack(">f", nearest) + image
    return jpeg[:2] + b"\xff\xe9" + struct.pack(">H", len(content) + 2) + content + jpeg[2:]


def decoded_depth(page: Page, jpeg: bytes) -> dict[str, Any] | None:
    depth: dict[str, Any] | None = page.evaluate(
        """async (jpeg) => {
          const { decodeDepth } = await import("/depth.js");
          const depth = await decodeDepth(new Blob([bytes(jpeg)]));
          return depth && { ...depth, codes: [...depth.codes] };
        }""",
        base64.b64encode(jpeg).decode(),
    )
    return depth


@pytest.mark.parametrize(
    ("kind", "options"),
    [("webp", {"lossless": True}), ("webp", {"quality": 95}), ("jpeg", {"quality": 95}), ("png", {})],
)
def test_a_frame_s_depth_has_the_codes_that_were_sent(page: Page, kind: str, options: dict[str, Any]) -> None:
    y, x = np.mgrid[:104, :184]
    codes = np.round(127.5 + 127.5 * np.sin(x / 40) * np.cos(y / 30)).astype(np.uint8)
    frame = encoded(noise(32, 18), "jpeg")
    sent = encoded(codes, kind, **options)
    depth = decoded_depth(page, with_depth(frame, 0.25, sent))
    assert depth is not None
    assert (depth["width"], depth["height"], depth["nearest"]) == (184, 104, 0.25)
    with Image.open(io.BytesIO(sent)) as image:
        expected = np.asarray(image.convert("L"), dtype=int)
    assert np.abs(np.reshape(depth["codes"], codes.shape) - expected).max() <= 1


def test_the_page_reads_the_depth_that_the_server_writes(page: Page) -> None:
    y, x = np.mgrid[:104, :184]
    inverse = (0.3 + 0.2 * np.sin(x / 40) * np.cos(y / 30)).astype(np.float32)
    depth = decoded_depth(page, depth_segment.with_depth(encoded(noise(32, 18), "jpeg"), inverse))
    assert depth is not None
    found = depth["nearest"] * np.reshape(depth["codes"], inverse.shape) / 255
    assert np.abs(found - inverse).mean() < 0.005


@pytest.mark.parametrize(
    "image", [b"no image", encoded(noise(64, 36), "png")[:99], encoded(np.zeros((1, 20_000), np.uint8), "png")]
)
def test_a_broken_depth_is_none(page: Page, image: bytes) -> None:
    frame = encoded(noise(32, 18), "jpeg")
    assert decoded_depth(page, with_depth(frame, 0.25, image)) is None
    assert decoded_depth(page, frame) is None
