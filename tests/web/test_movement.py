"""Movement traces in the page: the camera follows a file, a recording matches the view, and the user takes over."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import av
import numpy as np
import pytest
from numpy.typing import NDArray
from playwright.sync_api import Page, expect

from tests.web.conftest import OpenPage
from tests.web.movements import Poses, choose, expect_state, opened, press, turning_walk, wait_until_there
from tests.web.server import RenderServer
from tests.web.stage import hold, wait_until_settled
from tigas_experiments.movement.trace import MovementTrace

MICRO = 5e-6
"""The page rounds a person's poses to a millionth, and files are written to a millionth."""


@pytest.fixture
def visit(open_page: OpenPage, server: RenderServer) -> tuple[Page, Poses]:
    """A viewer with recorded requests, and open settings."""
    return opened(open_page, server.url)


def assert_on_the_walk(poses: Poses) -> None:
    """All poses are from `turning_walk`."""
    x = poses.positions[:, 0]
    np.testing.assert_allclose(poses.positions[:, 1:], 0, atol=MICRO)
    zero = np.zeros_like(x)
    expected = np.column_stack((zero, np.sin(x / 2), zero, np.cos(x / 2)))
    np.testing.assert_allclose(poses.quaternions, expected, atol=MICRO)


def test_the_camera_follows_a_file_and_the_person_goes_on_from_its_end(visit: tuple[Page, Poses]) -> None:
    page, poses = visit
    choose(page, turning_walk(1500))
    expect(page.get_by_role("radio", name="walk.csv")).to_be_checked()
    expect(page.locator(".movement")).to_contain_text("A walk along x")
    poses.clear()
    press(page, "Play")
    expect(page.locator(".movement-status")).to_contain_text("Your input is ignored")
    page.locator(".stage").focus()
    page.keyboard.press("KeyA", delay=300)
    expect_state(page, "stopped")
    wait_until_settled(page)
    expect(page.locator(".movement-status")).to_have_count(0)
    expect(page.locator(".movement-progress output")).to_have_text("0:01 / 0:01")
    assert len(poses) > 2
    assert_on_the_walk(poses)
    assert (np.diff(poses.positions[:, 0]) >= -MICRO).all()
    assert poses.positions[-1] == pytest.approx((1, 0, 0), abs=MICRO)

    poses.clear()
    page.locator(".stage").focus()
    hold(page, "KeyD")
    wait_until_settled(page)
    ahead = poses.positions - (1, 0, 0)
    assert np.linalg.norm(ahead[0]) < 0.5, "the camera jumped"
    assert ahead[-1] @ (np.cos(1), 0, -np.sin(1)) > 0.1, "to the right of where the walk had turned to"


def test_whoever_stops_a_movement_has_the_camera_where_it_is(visit: tuple[Page, Poses]) -> None:
    page, poses = visit
    choose(page, turning_walk(60_000))

    def close_settings_and_stop() -> None:
        press(page, "Close lab")
        press(page, "Stop the movement")
        press(page, "Lab")

    ways: list[Callable[[], None]] = [
        lambda: page.keyboard.press("Escape"),
        lambda: press(page, "Stop"),
        close_settings_and_stop,
    ]
    for stop in ways:
        poses.clear()
        press(page, "Play")
        wait_until_there(page, poses, lambda at: bool(at[0] > 0))
        stop()
        expect_state(page, "stopped")
        wait_until_settled(page)
        expect(page.locator(".movement-status")).to_have_count(0)
        stood, turned = poses.positions[-1], poses.quaternions[-1, 1]
        assert 0 < stood[0] < 0.9
        poses.clear()
        page.locator(".stage").focus()
        hold(page, "ArrowRight")
        wait_until_settled(page)
        assert poses.positions == pytest.approx(np.tile(stood, (len(poses), 1)), abs=1e-3), "turning is no walking"
        assert poses.quaternions[-1, 1] > turned


def test_a_recording_replays_what_was_seen(open_page: OpenPage, server: RenderServer, tmp_path: Path) -> None:
    page, poses = opened(open_page, server.url)
    poses.clear()
    press(page, "Record")
    expect(page.locator(".movement-status")).to_contain_text("Recording")
    page.locator(".stage").focus()
    page.keyboard.down("KeyW")
    hold(page, "ArrowRight")
    page.keyboard.up("KeyW")
    page.wait_for_timeout(300)
    hold(page, "ArrowUp")
    wait_until_settled(page)
    press(page, "Stop recording")
    expect(page.get_by_role("radio", name="Recording 1")).to_be_checked()
    expect(page.locator(".movement")).to_contain_text("not saved yet")
    with page.expect_download() as downloading:
        page.get_by_role("button", name="Save as CSV").click()
    expect(page.locator(".movement")).not_to_contain_text("not saved yet")
    assert downloading.value.suggested_filename.startswith("movement-pebbles-20")
    path = tmp_path / "recorded.csv"
    downloading.value.save_as(path)

    trace = MovementTrace.read(path)
    assert (trace.anchor, trace.comments["scene"]) == ("scene", "pebbles")
    assert trace.duration_ms > 300
    kept = np.hstack((trace.positions, trace.quaternions))
    seen = np.hstack((poses.positions, poses.quaternions))
    assert len(seen) >= 5
    assert distances(seen, kept).max() < MICRO, "every view that was seen is in the file"

    again, replayed = opened(open_page, server.url)
    choose(again, path)
    replayed.clear()
    press(again, "Play")
    expect_state(again, "playing")
    expect_state(again, "stopped")
    wait_until_settled(again)
    dense = np.hstack(trace.poses_at(np.arange(0, trace.duration_ms + 1)))
    shown = np.hstack((replayed.positions, replayed.quaternions))
    assert len(shown) >= 5
    assert distances(shown, dense).max() < 2e-3, "between two recorded poses it goes straight"
    assert shown[-1] == pytest.approx(kept[-1], abs=MICRO)


def test_a_movement_is_saved_as_a_video(visit: tuple[Page, Poses], tmp_path: Path) -> None:
    page, _ = visit
    choose(page, turning_walk(500))
    with page.expect_download() as downloading:
        page.get_by_role("button", name="Save as video").click()
    path = tmp_path / downloading.value.suggested_filename
    assert path.stem == "walk"
    downloading.value.save_as(path)
    with av.open(path) as video:
        frames = [frame.to_ndarray(format="gray").astype(np.int16) for frame in video.decode(video=0)]
        assert video.streams.video[0].average_rate == 30
    stage = page.locator(".stage").bounding_box()
    assert stage is not None
    assert frames[0].shape == (stage["height"] // 2 * 2, stage["width"] // 2 * 2)
    assert len(frames) == 16
    assert frames[0].std() > 10, "the first frame is blank"
    assert np.abs(frames[-1] - frames[0]).mean() > 10, "the camera stands still"

    choose(page, turning_walk(60_000, name="long.csv"))
    page.get_by_role("button", name="Save as video").click()
    expect(page.get_by_role("progressbar", name="Saving the video")).to_be_visible()
    page.get_by_role("button", name="Cancel").click()
    expect(page.get_by_role("button", name="Save as video")).to_be_visible()


def distances(these: NDArray[np.float64], those: NDArray[np.float64]) -> NDArray[np.float64]:
    """How far each of these is from the nearest of those."""
    nearest: NDArray[np.float64] = np.linalg.norm(these[:, None] - those[None], axis=2).min(axis=1)
    return nearest
