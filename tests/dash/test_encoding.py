"""Every representation comes of one rendered frame, and the stream outlives its encoder."""

from __future__ import annotations

from typing import Any

import av
import pytest
from websockets.exceptions import ConnectionClosed

from tests.dash.conftest import Packager, announcement
from tigas_dash.encoder import Encoder

pytestmark = pytest.mark.anyio


async def test_one_render_per_tick_makes_every_representation(packager: Packager) -> None:
    session = await packager.open(representations=[{"rung": 3}, {"rung": 2}, {"rung": 2, "bitrate_kbps": 900}])
    names = [(one["id"], one["width"], one["height"], one["bitrate_kbps"]) for one in session["representations"]]
    assert names == [("r2-1414", 640, 360, 1414), ("r2-900", 640, 360, 900), ("r3-500", 320, 180, 500)]
    await packager.until(session, lambda status: status["frames"] >= 15)
    assert {(one.width, one.height) for one in packager.render.requests} == {(640, 360)}
    for name, *_ in names:
        greys = await packager.brightness(session, 1, name)
        assert list(greys.values()) == pytest.approx([100] * len(greys), abs=4)
        assert greys


@pytest.mark.parametrize(("rungs", "display_scale"), [([3], 4), ([3, 2], 2), ([0, 3], 1)])
async def test_the_view_is_rendered_for_the_viewport_that_it_is_shown_on(
    packager: Packager, rungs: list[int], display_scale: float
) -> None:
    await packager.open(representations=[{"rung": rung} for rung in rungs], width=1280, height=720)
    assert packager.render.requests[0].display_scale == pytest.approx(display_scale)


async def test_an_encoder_that_fails_is_replaced(packager: Packager, monkeypatch: pytest.MonkeyPatch) -> None:
    session = await packager.open()
    encode, failing = Encoder.encode, {7}

    def fail_once(self: Encoder, frame: av.VideoFrame, number: int, *, keyframe: bool) -> Any:
        if number % 15 in failing:
            failing.clear()
            raise ValueError("no")
        return encode(self, frame, number, keyframe=keyframe)

    monkeypatch.setattr(Encoder, "encode", fail_once)
    await packager.until(session, lambda status: status["encoder_failures"] == 1)
    status = await packager.status(session)
    assert await packager.brightness(session, (status["frames"] + status["dropped"]) // 15 + 1)


async def test_an_encoder_that_fails_for_good_ends_the_stream(
    packager: Packager, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = await packager.open()
    async with packager.poses(session) as socket_:

        def fail(*_: object, **__: object) -> Any:
            raise ValueError("no")

        monkeypatch.setattr(Encoder, "encode", fail)
        with pytest.raises(ConnectionClosed) as closed:
            await announcement(socket_, lambda _: False)
    assert closed.value.rcvd is not None
    assert closed.value.rcvd.code == 4001
    assert (await packager.http.get(session["manifest"])).status_code == 404
    monkeypatch.undo()
    await packager.open()
