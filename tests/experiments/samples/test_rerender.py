"""A run's samples are rendered again, and compared by number, under any circumstances."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path
from typing import Any

import httpx
import pytest
from PIL import Image

from tests.experiments.made_up import inputs, write_run
from tests.experiments.samples.renderers import FakeRenderer, patient_client, picture, problem, sampled_run
from tests.not_files import NOT_FILES
from tigas_common.errors import StartError
from tigas_common.render_requests import MAX_CONCURRENT, RenderUnavailable
from tigas_experiments.quality.picture import CaptureQuality, compare, decode
from tigas_experiments.records.files import write_lines
from tigas_experiments.records.folder import StoredRun, capture_path
from tigas_experiments.records.samples import (
    JPEG,
    REPLAYED,
    RERENDERED,
    TRUTH,
    SampledRun,
    read_rerendered,
    sample_path,
)
from tigas_experiments.records.scores import Score, write_scores
from tigas_experiments.records.summary import summarise
from tigas_experiments.samples.capture_truth import render_truth
from tigas_experiments.samples.rerender import lock_experiment, require_sampled_runs, rerender
from tigas_experiments.wire.recording import Capture, Input

pytestmark = pytest.mark.anyio


@pytest.fixture
def run(tmp_path: Path) -> Path:
    return tmp_path / "run"


async def made(run: Path, renderer: FakeRenderer) -> SampledRun:
    async with renderer.client() as client:
        return await rerender(run, client)


async def test_the_same_server_sends_the_same_bytes_and_ground_truth_as_large_as_what_was_shown(
    run: Path,
) -> None:
    sampled_run(run, [3, 7])
    told: list[tuple[int, int]] = []
    async with FakeRenderer().client() as client:
        found = await rerender(run, client, lambda done, total: told.append((done, total)))
    assert (found.identical, found.different, found.missing, found.problems) == (2, 0, 0, [])
    assert told == [(0, 2), (1, 2), (2, 2)]
    for seq in (3, 7):
        assert not sample_path(run, seq, REPLAYED).exists()
        with Image.open(sample_path(run, seq, TRUTH)) as truth:
            assert (truth.format, truth.size) == ("PNG", (64, 36))
        assert decode(sample_path(run, seq, TRUTH).read_bytes())[0, 0, 1] == 20 * seq, "the sample's own pose"


async def test_ground_truth_has_no_profile_or_deadline_and_fits_what_was_shown(run: Path) -> None:
    """A display of twice the density showed twice the pixels of an enhanced picture: the view stays the same."""
    (one,) = sampled_run(run, [3])
    request = one.request.model_copy(update={"deadline_ms": 50.0})
    line = one.model_copy(update={"width": 128, "height": 72, "enhanced": True, "request": request})
    (run / "samples.ndjson").write_text(line.model_dump_json() + "\n")
    asked: list[dict[str, Any]] = []
    assert (await made(run, FakeRenderer(refuse=lambda wanted: asked.append(wanted)))).missing == 0
    again, truth = asked
    assert again == json.loads(request.model_copy(update={"deadline_ms": None}).model_dump_json(exclude_none=True))
    assert truth == {key: value for key, value in again.items() if key != "profile"} | {
        "format": "png",
        "width": 128,
        "height": 72,
        "fx": 60,
        "fy": 60,
        "cx": 64,
        "cy": 36,
    }


async def test_ground_truth_of_a_frame_with_overscan_has_its_margins(run: Path) -> None:
    (one,) = sampled_run(run, [3])
    request = one.request.model_copy(update={"overscan": 0.25, "depth": True})
    (run / "samples.ndjson").write_text(one.model_copy(update={"request": request}).model_dump_json() + "\n")
    asked: list[dict[str, Any]] = []
    assert (await made(run, FakeRenderer(refuse=lambda wanted: asked.append(wanted)))).missing == 0
    again, truth = asked
    assert (again["overscan"], again["depth"]) == (0.25, True)
    wider = {"width": 96, "height": 54, "fx": 30, "fy": 30, "cx": 48, "cy": 27, "overscan": 0, "depth": False}
    assert wider.items() <= truth.items()


async def test_a_renderer_that_answers_differently_is_flagged_and_what_it_sent_is_kept(run: Path) -> None:
    sampled_run(run, [3, 7])
    found = await made(run, FakeRenderer(shade=60))
    assert (found.identical, found.different, found.missing) == (0, 2, 0)
    known = read_rerendered(run)
    for seq in (3, 7):
        assert sample_path(run, seq, REPLAYED).read_bytes() == picture(seq, 32, 18, "JPEG", 60)
        assert sample_path(run, seq, JPEG).read_bytes() == picture(seq, 32, 18, "JPEG")
        assert known[seq].identical is False
        assert 10 < (known[seq].psnr_db or 0) < 20, "a third of the channels is off by 60"


async def test_everything_is_matched_by_number_whatever_the_order_and_whatever_is_missing(run: Path) -> None:
    """Answers arrive out of order, lines and files have yet another order, and one frame is missing."""
    sampled_run(run, [12, 3, 9, 7, 5])
    sample_path(run, 9, JPEG).unlink()
    renderer = FakeRenderer()
    slow = asyncio.Event()

    async def answer(request: httpx.Request) -> httpx.Response:
        if json.loads(request.content or b"{}").get("seq") == 12:
            await slow.wait()
        answered = await renderer(request)
        if len(renderer.asked) == 8:  # all of the others are through
            slow.set()
        return answered

    async with httpx.AsyncClient(base_url="http://render", transport=httpx.MockTransport(answer)) as http:
        found = await rerender(run, patient_client(http))
    assert renderer.asked[-1][0] == 12
    lines = [json.loads(line) for line in (run / RERENDERED).read_text().splitlines()]
    assert {line["seq"]: line["identical"] for line in lines} == {3: True, 5: True, 7: True, 9: None, 12: True}
    assert found.problems == ["The frame received in the run cannot be read: No such file or directory."]
    for seq in (3, 5, 7, 9, 12):
        assert decode(sample_path(run, seq, TRUTH).read_bytes())[0, 0, 1] == 20 * seq


async def test_what_is_there_is_not_asked_for_again_after_a_kill(run: Path) -> None:
    """It is interrupted between samples, with half a line and half a picture left behind."""
    numbers = list(range(1, 13))
    sampled_run(run, numbers)
    first, stuck, all_stuck, never = FakeRenderer(), 0, asyncio.Event(), asyncio.Event()

    async def answer(request: httpx.Request) -> httpx.Response:
        nonlocal stuck
        if len(first.asked) >= 10:
            stuck += 1
            if stuck == MAX_CONCURRENT:
                all_stuck.set()
            await never.wait()
        return await first(request)

    async with httpx.AsyncClient(base_url="http://render", transport=httpx.MockTransport(answer)) as http:
        task = asyncio.create_task(rerender(run, patient_client(http)))
        await all_stuck.wait()
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
    complete = set(read_rerendered(run))
    assert 0 < len(complete) < 12
    with (run / RERENDERED).open("a") as file:
        file.write('{"seq": 12, "ident')
    (run / "samples" / ".000012.truth.png.part").write_bytes(b"half")

    second = FakeRenderer()
    found = await made(run, second)
    assert (found.identical, found.missing) == (12, 0)
    assert {seq for seq, _ in second.asked} == set(numbers) - complete
    assert sorted(path.name for path in (run / "samples").iterdir() if path.suffix == ".part") == []

    nobody = FakeRenderer(refuse=lambda _: pytest.fail("nothing is asked for"), file_sha256="b" * 64)
    assert (await made(run, nobody)).identical == 12


async def test_a_renderer_that_goes_away_costs_nothing_that_is_there(run: Path) -> None:
    sampled_run(run, range(1, 9))

    def goes(wanted: dict[str, Any]) -> None:
        if wanted["seq"] == 6:
            raise httpx.ConnectError("refused")

    with pytest.raises(RenderUnavailable, match=r"The render service at http://render does not answer \(refused\)\."):
        await made(run, FakeRenderer(refuse=goes))
    assert (await made(run, FakeRenderer())).identical == 8


async def test_only_so_many_are_asked_for_at_once(run: Path) -> None:
    sampled_run(run, range(1, 20))
    renderer, at_once, most = FakeRenderer(), 0, 0

    async def answer(request: httpx.Request) -> httpx.Response:
        nonlocal at_once, most
        at_once += 1
        most = max(most, at_once)
        await asyncio.sleep(0)
        at_once -= 1
        return await renderer(request)

    async with httpx.AsyncClient(base_url="http://render", transport=httpx.MockTransport(answer)) as http:
        await rerender(run, patient_client(http))
    assert 1 < most <= MAX_CONCURRENT


async def test_a_busy_service_is_asked_again(run: Path) -> None:
    sampled_run(run, [1, 2])
    busy = iter([problem(503, "Too much.", **{"Retry-After": "0"}), problem(409, "Newer.", **{"Retry-After": "0"})])
    assert (await made(run, FakeRenderer(refuse=lambda _: next(busy, None)))).identical == 2


async def test_what_the_service_refuses_is_said_and_asked_for_again_the_next_time(run: Path) -> None:
    """Such as a rung that its ladder does not have: ground truth has none, and is there."""
    sampled_run(run, [1, 2])
    sentence = "profile: the ladder has rungs 0 to 1."
    found = await made(run, FakeRenderer(refuse=lambda wanted: problem(400, sentence) if "profile" in wanted else None))
    assert (found.identical, found.missing, found.problems) == (0, 2, [sentence])
    assert sample_path(run, 1, TRUTH).is_file()
    again = FakeRenderer()
    assert (await made(run, again)).identical == 2
    assert {form for _, form in again.asked} == {"jpeg"}


@pytest.mark.parametrize(
    ("answer", "sentence"),
    [
        (httpx.Response(200, content=b"<html>"), "cannot be read"),
        (httpx.Response(200, content=picture(0, 64, 36, "PNG")[:-30]), "cannot be read"),
        (httpx.Response(200, content=picture(0, 64, 36, "JPEG")), "not PNG"),
        (httpx.Response(200, content=picture(0, 65, 36, "PNG")), "65×36 pixels, not 64×36"),
    ],
)
async def test_no_other_answer_is_taken_for_ground_truth(run: Path, answer: httpx.Response, sentence: str) -> None:
    sampled_run(run, [1])
    found = await made(run, FakeRenderer(refuse=lambda wanted: answer if wanted["format"] == "png" else None))
    assert found.identical == 1
    (told,) = found.problems
    assert sentence in told
    assert not sample_path(run, 1, TRUTH).exists()


async def test_a_scene_whose_file_has_changed_is_no_ground_truth(run: Path) -> None:
    sampled_run(run, [1])
    renderer = FakeRenderer(file_sha256="b" * 64)
    found = await made(run, renderer)
    assert found.problems == [
        "The file of the scene 'courtyard' has changed since the run, so the service cannot render its ground truth."
    ]
    assert (found.missing, renderer.asked) == (1, [])
    unknown = FakeRenderer(file_sha256=None)
    assert (await made(run, unknown)).identical == 1, "what nobody knows is no change"


async def test_samples_of_another_scene_are_not_asked_for(run: Path) -> None:
    """A scene without a known checksum."""
    (one,) = sampled_run(run, [1])
    other = one.model_copy(update={"request": one.request.model_copy(update={"scene": "garden"})})
    (run / "samples.ndjson").write_text(other.model_dump_json() + "\n")
    renderer = FakeRenderer()
    assert (await made(run, renderer)).problems == ["Its samples are of another scene than the run."]
    assert renderer.asked == []


async def test_everything_can_be_asked_for_again(run: Path) -> None:
    """Such as from the original server, after another one."""
    sampled_run(run, [1, 2])
    assert (await made(run, FakeRenderer(shade=60))).different == 2
    assert (await made(run, FakeRenderer())).different == 2, "what is there is not asked for"
    async with FakeRenderer().client() as client:
        found = await rerender(run, client, again=True)
    assert (found.identical, found.different) == (2, 0)
    for seq in (1, 2):
        assert not sample_path(run, seq, REPLAYED).exists()
        assert decode(sample_path(run, seq, TRUTH).read_bytes())[..., 2].max() == 0


async def test_a_run_without_samples_is_left_alone(tmp_path: Path) -> None:
    run = write_run(tmp_path / "runs" / "old")
    assert (await made(run, FakeRenderer())).samples == ()
    assert not (run / RERENDERED).exists()
    with pytest.raises(StartError, match="has no samples: only runs with a `sample_stride` do"):
        require_sampled_runs(tmp_path)
    with pytest.raises(StartError, match="neither a run nor an experiment"):
        require_sampled_runs(tmp_path / "nothing")


async def test_runs_are_found_from_an_experiment_and_by_themselves(tmp_path: Path) -> None:
    write_run(tmp_path / "runs" / "old")
    sampled_run(tmp_path / "runs" / "new", [1])
    assert (
        require_sampled_runs(tmp_path) == require_sampled_runs(tmp_path / "runs" / "new") == [tmp_path / "runs" / "new"]
    )
    with (
        lock_experiment(tmp_path / "runs" / "new"),
        pytest.raises(StartError, match="Another command is using"),
        lock_experiment(tmp_path),
    ):
        pass


@pytest.mark.parametrize("kind", NOT_FILES)
@pytest.mark.parametrize("name", [JPEG, TRUTH, REPLAYED])
async def test_what_is_no_file_gets_a_sentence_and_costs_no_other_sample(run: Path, name: str, kind: str) -> None:
    sampled_run(run, [1, 2])
    hostile = sample_path(run, 1, name)
    hostile.unlink(missing_ok=True)
    NOT_FILES[kind](hostile)
    found = await made(run, FakeRenderer(shade=0 if name == TRUTH else 60))
    assert found.known[2].problem is None
    assert (name == JPEG or kind == "folder") == bool(found.problems), "what can be replaced is"


async def test_links_lead_nowhere(tmp_path: Path) -> None:
    """Neither are files outside read through them, nor written."""
    run, outside = tmp_path / "run", tmp_path / "outside"
    sampled_run(run, [1, 2])
    outside.mkdir()
    mine = outside / "mine"
    mine.write_bytes(picture(1, 32, 18, "JPEG"))
    sample_path(run, 1, JPEG).unlink()
    sample_path(run, 1, JPEG).symlink_to(mine)
    sample_path(run, 1, TRUTH).symlink_to(mine)
    (run / "samples" / ".000002.truth.png.part").symlink_to(mine)
    found = await made(run, FakeRenderer())
    assert (found.known[1].identical, found.known[2].identical) == (None, True)
    assert mine.read_bytes() == picture(1, 32, 18, "JPEG")
    assert not sample_path(run, 1, TRUTH).is_symlink()

    (run / RERENDERED).unlink()
    (run / RERENDERED).symlink_to(mine)
    assert "cannot be read" in " ".join((await made(run, FakeRenderer())).problems)
    (run / RERENDERED).unlink()
    (run / "samples").rename(outside / "samples")
    (run / "samples").symlink_to(outside / "samples")
    assert "is not a folder of images" in " ".join((await made(run, FakeRenderer())).problems)
    assert mine.read_bytes() == picture(1, 32, 18, "JPEG")


@pytest.mark.parametrize("data", [b"", b"\xff\xd8\xff", picture(1, 32, 18, "JPEG")[:200]])
async def test_a_broken_frame_gets_a_sentence(run: Path, data: bytes) -> None:
    sampled_run(run, [1])
    sample_path(run, 1, JPEG).write_bytes(data)
    found = await made(run, FakeRenderer())
    assert found.known[1].identical is None
    assert found.problems


async def test_broken_ground_truth_is_asked_for_again(run: Path) -> None:
    sampled_run(run, [1, 2])
    await made(run, FakeRenderer())
    whole = sample_path(run, 1, TRUTH).read_bytes()
    sample_path(run, 1, TRUTH).write_bytes(whole[:-20])
    again = FakeRenderer()
    await made(run, again)
    assert sample_path(run, 1, TRUTH).read_bytes() == whole
    assert {seq for seq, _ in again.asked} == {1}


async def test_records_that_are_broken_get_a_sentence(run: Path, tmp_path: Path) -> None:
    sampled_run(run, [1])
    (run / "samples.ndjson").write_text("{}\n")
    assert "samples.ndjson, line 1" in (await made(run, FakeRenderer())).problems[0]
    sampled_run(tmp_path / "other", [1])
    (tmp_path / "other" / "run.json").write_text("{}")
    assert "run.json is broken" in (await made(tmp_path / "other", FakeRenderer())).problems[0]


LATE = 4
"""At 90 ms the viewer is at x = 4; the picture is from x = 1."""


def kept_run(folder: Path) -> Path:
    """With two pictures: one from before the movement."""
    run = write_run(folder)
    shown = picture(1, 64, 36, "PNG")
    taken = [Capture(at=at, shown_at=at, pose=2, rung=2, width=64, height=36) for at in (-10.0, 90.0)]
    write_lines(run / "captures.ndjson", taken)
    for index in range(2):
        capture_path(run, index).write_bytes(shown)
    seen = compare(decode(shown), decode(picture(LATE, 64, 36, "PNG")))
    quality = CaptureQuality(at=90.0, pose=2, rung=2, picture=None, view=None, seen=seen)
    write_lines(run / "quality.ndjson", [quality])
    assert StoredRun(run).read(Input)[LATE] == inputs(5)[LATE]
    return run


async def test_it_is_of_the_pose_that_the_viewer_had_and_rendered_once(tmp_path: Path) -> None:
    run, renderer = kept_run(tmp_path / "run"), FakeRenderer()
    async with renderer.client() as client:
        assert await render_truth(run, client) is None
        assert await render_truth(run, client) is None
    assert len(renderer.asked) == 1
    assert decode(capture_path(run, 1, TRUTH).read_bytes())[0, 0, 1] == 20 * LATE
    assert not capture_path(run, 0, TRUTH).exists()


async def test_another_renderer_s_is_not_kept(tmp_path: Path) -> None:
    run = kept_run(tmp_path / "run")
    async with FakeRenderer(shade=90).client() as client:
        problem = await render_truth(run, client)
    assert problem is not None
    assert problem.startswith("Picture 1: the renderer answers differently now")
    assert not capture_path(run, 1, TRUTH).exists()


async def test_another_scene_is_not_even_asked(tmp_path: Path) -> None:
    run, renderer = kept_run(tmp_path / "run"), FakeRenderer()
    record = StoredRun(run).record.model_copy(update={"scene_sha256": "b" * 64})
    (run / "run.json").write_text(record.model_dump_json())
    async with renderer.client() as client:
        assert "has changed since the run" in (await render_truth(run, client) or "")
    assert renderer.asked == []


def test_what_they_say_is_a_figure_of_the_run(tmp_path: Path) -> None:
    run = kept_run(tmp_path / "run")
    seen = [Score(seq=number, picture="seen", digest="x", lpips=lpips) for number, lpips in enumerate((0.2, 0.4))]
    write_scores(run, [*seen, Score(seq=1, picture="original", digest="x", lpips=0.9)])
    figures = summarise(run).figures
    assert figures is not None
    assert figures.values["seen_lpips"] == pytest.approx(0.3)
