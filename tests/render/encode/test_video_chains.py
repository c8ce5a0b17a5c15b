"""Viewers' videos: every frame refers to the last one received by its viewer, or to none."""

from __future__ import annotations

import contextlib
import threading

import pytest

from tests.render.encode.test_h264 import HEIGHT, WIDTH, picture
from tigas_common.errors import Superseded
from tigas_common.wire.render import VideoInfo, VideoRequest
from tigas_render.encode import video_chains
from tigas_render.encode.h264 import EncodingFailed, H264Encoder
from tigas_render.encode.video_chains import IDLE_S, STILL_S, VideoChains
from tigas_render.frame import Client

ANN, BOB, CAL = (Client("somewhere", name) for name in ("Ann", "Bob", "Cal"))


class Videos:
    """Chains with a clock that the test sets."""

    def __init__(self, most: int = 8) -> None:
        self.now = 0.0
        self.chains = VideoChains(most, lambda: self.now)

    def next(self, seq: int, client: Client = ANN, *, kbps: int = 3000, key: bool = False, size: int = 1) -> VideoInfo:
        video = VideoRequest(bitrate_kbps=kbps, key=key)
        width, height = WIDTH // size, HEIGHT // size
        return self.chains.encode(client, seq, video, width, height, picture(seq, width, height))[1]


def after(info: VideoInfo) -> int | None:
    """The frame that it refers to."""
    assert info.key == (info.after is None)
    return info.after


def test_each_frame_refers_to_the_last_one_of_its_viewer() -> None:
    videos = Videos()
    assert [after(videos.next(seq)) for seq in (1, 2)] == [None, 1]
    assert [after(videos.next(seq, BOB)) for seq in (7, 9)] == [None, 7]
    assert after(videos.next(5)) == 2


def test_a_viewer_gets_a_key_frame_on_demand() -> None:
    videos = Videos()
    assert [after(videos.next(1)), after(videos.next(2, key=True)), after(videos.next(3))] == [None, None, 2]


def test_an_older_view_is_not_encoded_after_a_newer_one() -> None:
    videos = Videos()
    videos.next(5)
    with pytest.raises(Superseded):
        videos.next(4)
    assert after(videos.next(6)) == 5
    assert after(videos.next(4, key=True)) is None, "a restarted numbering"


def test_what_follows_a_frame_that_was_lost_begins_anew() -> None:
    videos = Videos()
    videos.next(1)
    videos.next(2)
    videos.chains.mark_lost(ANN, 2)
    assert [after(videos.next(seq)) for seq in (3, 4)] == [None, 3]
    videos.chains.mark_lost(ANN, 2)
    assert after(videos.next(5)) == 4, "the key frame since then is all that counts"


@pytest.mark.parametrize(("size", "kbps"), [(2, 3000), (1, 300), (1, 30_000)])
def test_a_switch_is_a_key_frame_and_the_video_goes_on_from_there(size: int, kbps: int) -> None:
    videos = Videos()
    videos.next(1)
    assert [after(videos.next(seq, size=size, kbps=kbps)) for seq in (2, 3)] == [None, 2]


def test_a_slightly_different_rate_is_no_switch() -> None:
    videos = Videos()
    assert [after(videos.next(seq, kbps=kbps)) for seq, kbps in ((1, 3000), (2, 2500), (3, 3500))] == [None, 1, 2]


def test_encoders_are_bounded_and_whoever_has_not_asked_for_the_longest_begins_anew() -> None:
    videos = Videos(most=2)
    videos.next(1, ANN)
    videos.next(1, BOB)
    videos.next(2, ANN)
    videos.next(1, CAL)
    assert len(videos.chains) == 2
    assert after(videos.next(3, ANN)) == 2
    assert after(videos.next(2, BOB)) is None


def test_no_address_takes_the_encoders_of_others() -> None:
    videos, elsewhere = Videos(most=3), Client("elsewhere", "Dot")
    videos.next(1, elsewhere)
    for seq in (1, 2):
        for client in (ANN, BOB, CAL):
            videos.next(seq, client)
    assert after(videos.next(2, elsewhere)) == 1


def test_a_large_video_counts_as_several(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(video_chains, "REFERENCE_PIXELS", WIDTH * HEIGHT // 4)
    videos = Videos(most=5)
    for client in (ANN, BOB):
        videos.next(1, client, size=2)
    videos.next(1, CAL)
    assert len(videos.chains) == 2
    assert after(videos.next(2, BOB, size=2)) == 1


def test_a_large_video_goes_on_while_others_rest(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(video_chains, "REFERENCE_PIXELS", WIDTH * HEIGHT // 4)
    videos, large = Videos(most=6), Client("elsewhere", "Dot")
    viewers = [Client(f"address {number}", "Ann") for number in range(6)]
    for viewer in viewers:
        videos.next(1, viewer, size=2)
    videos.now = STILL_S
    assert [after(videos.next(seq, large)) for seq in (1, 2)] == [None, 1]
    assert len(videos.chains) == 3
    videos.next(2, viewers[0], size=2)
    assert after(videos.next(3, large)) == 2, "it takes the place of another that rests"
    for viewer in viewers:
        videos.next(3, viewer, size=2)
    assert [after(videos.next(4, viewer, size=2)) for viewer in viewers] == [3] * 6, "it gives way if nobody rests"


def test_who_is_gone_or_idle_has_no_encoder_any_more() -> None:
    videos = Videos()
    videos.next(1, ANN)
    videos.chains.forget(ANN)
    assert len(videos.chains) == 0
    videos.next(2, ANN)
    videos.now = IDLE_S - 1
    videos.next(1, BOB)
    videos.now = IDLE_S
    videos.chains.forget_idle()
    assert len(videos.chains) == 1
    assert after(videos.next(3, ANN)) is None


def test_after_an_encoder_has_failed_a_new_one_begins(monkeypatch: pytest.MonkeyPatch) -> None:
    videos = Videos()
    videos.next(1)

    def fail(*_: object, **__: object) -> None:
        raise EncodingFailed("It broke.")

    with monkeypatch.context() as broken:
        broken.setattr(H264Encoder, "encode", fail)
        with pytest.raises(EncodingFailed):
            videos.next(2)
    assert [after(videos.next(seq)) for seq in (3, 4)] == [None, 3]


def test_several_threads_make_one_chain() -> None:
    videos = Videos()
    links: list[tuple[int, int | None]] = []
    begun = threading.Barrier(2)

    def encode(first: int) -> None:
        begun.wait()
        for seq in range(first, 40, 2):
            with contextlib.suppress(Superseded):
                links.append((seq, after(videos.next(seq, size=2))))

    threads = [threading.Thread(target=encode, args=(first,)) for first in (0, 1)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    links.sort()
    assert links[0][1] is None
    assert [link for _, link in links[1:]] == [seq for seq, _ in links[:-1]]
