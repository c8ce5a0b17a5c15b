"""Representations of a stream, and their encoding."""

from __future__ import annotations

from typing import Any

import av
import pytest
from websockets.exceptions import ConnectionClosed

from tests.dash.conftest import Packager, announcement, parsed_request
from tigas_common.errors import StartError
from tigas_common.wire.render import DEFAULT_LADDER, Rung
from tigas_dash import encoder as encoder_module
from tigas_dash.encoder import Encoder, choose_encoder
from tigas_dash.errors import EncoderUnavailable
from tigas_dash.representation import choose_representations

pytestmark = pytest.mark.anyio


def offered(**changes: object) -> list[tuple[str, int, int]]:
    """Name and size of each representation, for a viewer of the usual ladder."""
    return [
        (one.id, one.width, one.height) for one in choose_representations(parsed_request(**changes), DEFAULT_LADDER)
    ]


@pytest.mark.parametrize(
    ("viewport", "expected"),
    [
        ((640, 360), [("r2-4242", 640, 360), ("r2-1414", 640, 360), ("r3-500", 320, 180)]),
        ((1000, 600), [("r1-7800", 930, 558), ("r1-2600", 930, 558), ("r2-1415", 620, 372), ("r3-500", 310, 186)]),
        ((100, 100), [("r3-1500", 240, 240), ("r3-500", 240, 240)]),
    ],
)
def test_a_session_offers_no_more_pixels_than_are_shown_and_the_best_of_them_finer(
    viewport: tuple[int, int], expected: list[tuple[str, int, int]]
) -> None:
    width, height = viewport
    assert offered(width=width, height=height, representations=None) == expected


@pytest.mark.parametrize(
    ("viewport", "expected"),
    [
        ((1280, 720), ["r0-12000", "r0-4000", "r3-2096", "r5-1108", "r8-577"]),
        ((480, 270), ["r6-2757", "r6-919", "r8-577"]),
    ],
)
def test_of_a_ladder_with_many_rungs_a_few_sizes_are_offered(viewport: tuple[int, int], expected: list[str]) -> None:
    widths = (1280, 1120, 960, 832, 640, 544, 480, 480, 352, 352)
    ladder = [
        Rung(name=f"{i}", width=width, height=width * 9 // 16, quality=50, expected_kb=99 - i)
        for i, width in enumerate(widths)
    ]
    request = parsed_request(width=viewport[0], height=viewport[1], representations=None)
    assert [one.id for one in choose_representations(request, ladder)] == expected


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


def test_an_encoder_that_was_chosen_has_to_work_from_the_start(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise EncoderUnavailable("h264_nvenc cannot encode 640×360: Operation not permitted.")

    monkeypatch.setattr(encoder_module, "Encoder", fail)
    assert choose_encoder("auto") == choose_encoder("libx264") == "libx264"
    with pytest.raises(StartError, match=r"does not work here .*choose libx264 or auto"):
        choose_encoder("h264_nvenc")


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
