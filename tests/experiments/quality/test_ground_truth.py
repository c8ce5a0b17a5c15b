"""Which views a shown picture is compared with, and what is said when they cannot be had."""

from __future__ import annotations

import json

import httpx
import pytest

from tests.experiments.made_up import LENS, inputs, png
from tigas_common.wire.recording import Capture
from tigas_experiments.errors import RunFailed
from tigas_experiments.quality.ground_truth import GroundTruth

pytestmark = pytest.mark.anyio
SAMPLED = inputs(10)  # poses 1 to 10, at 0, 20, … ms, at x = 0, 1, …


class Renderer:
    """Answers with a picture that depends on where the camera stands; remembers what it was asked."""

    def __init__(self, answer: httpx.Response | None = None) -> None:
        self.asked: list[float] = []
        self._answer = answer

    def __call__(self, request: httpx.Request) -> httpx.Response:
        wanted = json.loads(request.content)
        assert (wanted["format"], wanted["width"], wanted["height"]) == ("png", LENS.width, LENS.height)
        assert "profile" not in wanted, "ground truth has the viewport's own resolution"
        self.asked.append(wanted["position"][0])
        return self._answer or httpx.Response(200, content=png(shade=int(20 * wanted["position"][0])))


def truth(renderer: Renderer) -> GroundTruth:
    """Of a scene that nobody has."""
    http = httpx.AsyncClient(base_url="http://render", transport=httpx.MockTransport(renderer))
    return GroundTruth(http, "courtyard", LENS)


def capture(at: float, pose: int) -> Capture:
    """A frame of a pose, shown at a time."""
    return Capture(at=at, pose=pose, rung=2, width=64, height=36)


async def test_a_picture_is_compared_with_its_own_pose_and_by_the_viewer_s() -> None:
    renderer = Renderer()
    quality = await truth(renderer).assess(png(shade=40), capture(at=110, pose=3), SAMPLED)
    assert renderer.asked == [2, 5], "pose 3 stands at x = 2; at 110 ms the newest pose is number 6, at x = 5"
    assert quality is not None
    assert quality.picture.psnr_db == 100
    assert quality.view.psnr_db < 30


async def test_a_picture_that_is_not_late_is_rendered_once() -> None:
    renderer = Renderer()
    quality = await truth(renderer).assess(png(shade=40), capture(at=45, pose=3), SAMPLED)
    assert renderer.asked == [2]
    assert quality is not None
    assert quality.picture == quality.view


@pytest.mark.parametrize(("at", "pose"), [(100, 0), (100, 11), (-5, 3)])
async def test_a_picture_from_outside_the_run_is_not_compared(at: float, pose: int) -> None:
    renderer = Renderer()
    assert await truth(renderer).assess(png(), capture(at, pose), SAMPLED) is None
    assert renderer.asked == []


@pytest.mark.parametrize(
    ("answer", "sentence"),
    [
        (httpx.Response(503, content=b"{}"), "the service answered 503"),
        (httpx.Response(200, content=b"<html>"), "cannot be read"),
    ],
)
async def test_a_service_that_fails_costs_the_run(answer: httpx.Response, sentence: str) -> None:
    with pytest.raises(RunFailed, match=sentence):
        await truth(Renderer(answer)).assess(png(), capture(100, 3), SAMPLED)
