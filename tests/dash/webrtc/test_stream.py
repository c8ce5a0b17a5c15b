"""Streams over WebRTC as their viewers meet them: aiortc at the other end of a real UDP port."""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np
import pytest

from tests.dash.conftest import Packager, pose, running_packager
from tests.dash.webrtc.viewer import Viewer, offer_of_nobody, watching, webrtc_request
from tests.eventually import eventually
from tests.prometheus import figures
from tigas_dash.webrtc.stream import WebRtcStream

pytestmark = pytest.mark.anyio


async def test_a_pose_shows_in_the_video_and_the_channel_says_in_which_frame(packager: Packager) -> None:
    async with watching(packager.http) as (viewer, session):
        assert (session["codec"], session["rung"], session["width"], session["height"]) == ("VP8", 3, 320, 180)
        await eventually(lambda: viewer.told and viewer.pictures)
        viewer.poses.send(pose(7, 200))
        await eventually(lambda: any(one["pose"] == 7 for one in viewer.told))
        await eventually(lambda: viewer.pictures[-1].to_ndarray()[:180].mean() == pytest.approx(200, abs=6))
        first = next(one["rtp_timestamp"] for one in viewer.told if one["pose"] == 7)
        steps = np.diff([one["rtp_timestamp"] for one in viewer.told])
        assert all(step > 0 and step % 3000 == 0 for step in steps), "timestamps are not the clock's"
        assert first in [one["rtp_timestamp"] for one in viewer.told]
        status = (await packager.http.get(f"/sessions/{session['id']}")).json()
        assert (status["poses"], status["watchers"]) == (1, 1)
    await packager.until_idle()
    ended = await figures(packager.http)
    labels = {"scene": "scene", "rung": "3", "transport": "webrtc"}
    assert ended("tigas_dash_frames_total", **labels) >= len(viewer.pictures)
    assert ended("tigas_dash_sent_bytes_total", **labels) > 1000
    assert ended("tigas_dash_poses_total", transport="webrtc") == 1


async def test_an_overtaken_pose_changes_nothing_and_an_unreadable_one_is_answered(packager: Packager) -> None:
    async with watching(packager.http) as (viewer, _):
        await eventually(lambda: viewer.told)
        viewer.poses.send(pose(9, 220))
        await eventually(lambda: any(one.get("pose") == 9 for one in viewer.told))
        for message in (pose(8, 30), "no JSON", "x" * 20_000, pose(10, 1).replace("[1", "[1e999")):
            viewer.poses.send(message)
        await eventually(lambda: len([one for one in viewer.told if "type" in one]) == 3)
        newest = len(viewer.told)
        await eventually(lambda: len(viewer.told) > newest + 5)
        assert {one["pose"] for one in viewer.told[newest:] if "pose" in one} == {9}


async def test_viewers_share_one_port_and_one_that_leaves_frees_its_place(packager: Packager) -> None:
    async with watching(packager.http) as (first, session), watching(packager.http) as (second, _):
        await eventually(lambda: first.told and second.told)
        second.poses.send(pose(3, 50))
        await eventually(lambda: any(one["pose"] == 3 for one in second.told))
        assert not any(one["pose"] == 3 for one in first.told)
        assert len(packager.sessions.all()) == 2
        assert (await packager.http.delete(f"/sessions/{session['id']}")).status_code == 204
        assert (await packager.http.get(f"/sessions/{session['id']}")).status_code == 404
        await eventually(lambda: first.connection.connectionState == "closed")
        count = len(second.told)
        await eventually(lambda: len(second.told) > count)
    await packager.until_idle()


async def test_all_kinds_of_streams_share_the_limit(packager: Packager) -> None:
    async with watching(packager.http) as (_viewer, session):
        for _ in range(2):
            await packager.open()
        answer = await packager.http.post("/webrtc", json=webrtc_request(await offer_of_nobody()))
        assert (answer.status_code, answer.json()["type"]) == (503, "tigas:too-many-sessions")
        assert (await packager.http.get(f"/sessions/{session['id']}/manifest.mpd")).status_code == 404


@pytest.mark.slow
async def test_a_viewer_who_never_comes_or_falls_silent_is_given_up() -> None:
    async with running_packager(idle_s=1) as packager:
        answer = await packager.http.post("/webrtc", json=webrtc_request(await offer_of_nobody()))
        assert answer.status_code == 201
        await packager.until_idle()
        async with watching(packager.http) as (viewer, _):
            await eventually(lambda: len(viewer.told) > 75)  # longer than it may be silent
            (stream,) = packager.sessions.all()
            assert isinstance(stream, WebRtcStream)
            stream._port._endpoint._received = lambda *_: None  # as if its link were cut
            await packager.until_idle()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda sdp: "v=0", "one video and one data transport"),
        (lambda sdp: sdp + sdp[sdp.index("m=") :], "one video and one data transport"),
        (lambda sdp: sdp.replace("VP8/90000", "AV1/90000").replace("H264/90000", "H265/90000"), "no video codec"),
        (lambda sdp: sdp.replace("a=group:BUNDLE 0 1", "a=other"), "BUNDLE"),
        (lambda sdp: sdp.replace("a=recvonly", "a=sendonly"), "does not request video"),
        (lambda sdp: sdp.replace("a=recvonly\r\n", ""), "not SDP"),
        (lambda sdp: sdp.replace("a=mid:0", "a=mid:9"), "BUNDLE"),
        (lambda sdp: sdp.replace("a=fmtp:", "a=fmtp:999999"), "not SDP"),
        (lambda sdp: sdp.replace("UDP/TLS/RTP/SAVPF", ""), "not SDP"),
        (lambda sdp: sdp.replace("a=fingerprint", "a=other"), "must have a fingerprint"),
        (lambda sdp: re.sub("a=fingerprint:sha-...", "a=fingerprint:md5", sdp), "must have a fingerprint"),
        (lambda sdp: re.sub("a=fingerprint:.*", "a=fingerprint:sha-256", sdp), "not SDP"),
        (lambda sdp: sdp.replace("a=setup:actpass", "a=setup:holdconn"), "not SDP"),
        (lambda sdp: sdp.replace("a=ice-ufrag", "a=other"), "not SDP"),
        (lambda sdp: sdp.replace("a=ice-pwd", "a=other"), "not SDP"),
        (lambda sdp: sdp.replace("a=sctp-port:5000", "a=sctp-port:99999"), "SCTP port"),
        (lambda sdp: sdp.replace("a=sctp-port:5000", "a=other"), "SCTP port"),
        (lambda sdp: re.sub("a=max-message-size:.*", "a=max-message-size:-1\r", sdp), "must accept messages"),
    ],
)
async def test_an_offer_that_cannot_be_answered_is_refused_in_a_sentence(
    packager: Packager, change: Callable[[str], str], said: str
) -> None:
    offer = await offer_of_nobody()
    assert change(offer) != offer
    answer = await packager.http.post("/webrtc", json=webrtc_request(change(offer)))
    assert (answer.status_code, answer.json()["type"]) == (400, "tigas:invalid-request"), answer.text
    assert said in answer.json()["detail"]
    assert packager.sessions.all() == []


async def test_what_is_asked_for_beside_the_offer_is_checked(packager: Packager) -> None:
    offer = await offer_of_nobody()
    h264 = offer.replace("VP8/90000", "AV1/90000")
    for changes, status in (
        ({"scene": "nowhere"}, 404), ({"rung": 9}, 400), ({"frame_rate": 25}, 400), ({"sdp": "x" * 70_000}, 400),
        ({"sdp": h264, "frame_rate": 60}, 400), ({"sdp": "x" * 200_000}, 413),
    ):  # fmt: skip
        answer = await packager.http.post("/webrtc", json=webrtc_request(offer) | changes)
        assert answer.status_code == status, answer.text
        assert answer.json()["detail"].endswith(".")
    assert packager.sessions.all() == []


@pytest.mark.parametrize("codec", ["VP8", "H264"])
async def test_a_bound_holds_whatever_the_link_carries(packager: Packager, codec: str) -> None:
    viewer = Viewer()
    offer = (await viewer.offer()).replace("VP8/90000", "AV1/90000" if codec == "H264" else "VP8/90000")
    answer = await packager.http.post("/webrtc", json=webrtc_request(offer, bitrate_kbps=150))
    assert answer.json()["codec"] == codec
    (stream,) = packager.sessions.all()
    assert isinstance(stream, WebRtcStream)
    encoder = vars(stream._connection.getSenders()[0])["_RTCRtpSender__encoder"]
    assert encoder.target_bitrate == 150_000, "it starts above the bound"
    for estimate, had in ((5_000_000, 150_000), (120_000, 120_000), (10_000, 100_000)):
        encoder.target_bitrate = estimate
        assert encoder.target_bitrate == had
    await viewer.take(answer.json()["sdp"])
    if codec == "VP8":  # the viewer did not offer the changed content
        await eventually(lambda: viewer.pictures)
    await viewer.leave()


async def test_without_candidates_of_the_viewers_it_is_found_by_where_it_is_heard_from(packager: Packager) -> None:
    viewer = Viewer()
    offer = "".join(line for line in (await viewer.offer()).splitlines(True) if "candidate" not in line)
    answer = await packager.http.post("/webrtc", json=webrtc_request(offer))
    await viewer.take(answer.json()["sdp"])
    await eventually(lambda: viewer.told)
    await viewer.leave()


async def test_a_viewer_elsewhere_hears_that_the_port_is_for_this_machine_alone(packager: Packager) -> None:
    """Its offer comes through the render service, and media would not."""
    offer = webrtc_request(await offer_of_nobody())
    answer = await packager.http.post("/webrtc", json=offer, headers={"Host": "192.0.2.7:8443"})
    assert (answer.status_code, answer.json()["type"]) == (503, "tigas:webrtc-unavailable")
    assert answer.json()["detail"].endswith("open it with --http 0.0.0.0:8081.")
    assert (await packager.http.get("/sessions")).json() == [], "it takes nobody's place"
