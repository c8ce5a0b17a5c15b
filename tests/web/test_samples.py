"""Samples of the page's experiments: kept in the browser, brought to the store, and not lost on the way."""

from __future__ import annotations

import io

import httpx
import pytest
from PIL import Image
from playwright.sync_api import Locator, Page, Route, expect

from tests.web.conftest import OpenPage
from tests.web.experiments import STORED_MS, PageLab, dialog, fill, outcome, progress, remarks, start
from tests.web.stage import SCENE, wait_for_frames
from tigas_experiments.records.folder import StoredRun
from tigas_experiments.records.samples import read_sample_file, read_samples, sample_path

PICTURES = "**/samples/*.jpg"
EVERY = 5


def begin(page: Page, name: str, seconds: str = "1.5") -> None:
    """An experiment of one run that samples frames."""
    wait_for_frames(page)
    fill(page, name=name, movement="store/turn", seconds=seconds)
    dialog(page).get_by_label("Seen").uncheck()
    dialog(page).get_by_role("textbox", name="Save every nth frame").fill(str(EVERY))
    start(page)


def play(page: Page, shown: int) -> None:
    """Until the movement has had the time for so many frames."""
    expect(progress(page)).to_contain_text("Playing the movement")
    page.wait_for_timeout(100 * shown)


def left(page: Page) -> Locator:
    """The runs with samples in this browser only."""
    return page.get_by_role("region", name="Samples in this browser").locator("tbody tr")


def the_run(lab: PageLab, name: str) -> StoredRun:
    """The only one of an experiment."""
    (folder,) = lab.results.glob(f"{name}-*/runs/*")
    return StoredRun(folder)


def check(lab: PageLab, run: StoredRun) -> None:
    """Each sample has its picture, which the same request still has as its answer."""
    samples = read_samples(run.folder)
    assert samples
    for sample in samples:
        jpeg = read_sample_file(sample_path(run.folder, sample.seq, "jpg"))
        assert len(jpeg) == sample.bytes
        with Image.open(io.BytesIO(jpeg)) as image:
            assert image.size == (sample.width, sample.height)
    answer = httpx.post(f"{lab.url}render", content=samples[0].request.model_dump_json(exclude_none=True))
    assert answer.content == read_sample_file(sample_path(run.folder, samples[0].seq, "jpg"))


def test_an_upload_that_is_cut_off_survives_a_reload_and_sends_only_the_rest(open_page: OpenPage, lab: PageLab) -> None:
    page = open_page(SCENE, url=lab.url, expected_errors="ERR_")
    sent: list[str] = []

    def cut_off_after_two(route: Route) -> None:
        if route.request.method == "PUT" and len(sent) == 2:
            return route.abort()
        sent.append(route.request.url)
        return route.continue_()

    page.route(PICTURES, cut_off_after_two)
    begin(page, "Cut off")
    remark = remarks(page)
    expect(remark).to_contain_text("Its samples are only in this browser. The store at", timeout=STORED_MS)
    assert read_samples(the_run(lab, "Cut-off").folder) == []
    page.unroute(PICTURES)
    page.goto(f"{lab.url}#/experiments")
    page.reload()
    expect(left(page)).to_have_count(1)
    expect(left(page).get_by_role("rowheader")).to_contain_text("Stateless latency")
    count, size = (left(page).get_by_role("cell").nth(cell).inner_text() for cell in (0, 1))
    assert int(count) > 2
    assert "B" in size
    again: list[str] = []
    page.on("request", lambda request: again.append(request.url) if request.method == "PUT" else None)
    left(page).get_by_role("button", name="Upload").click()
    expect(left(page)).to_have_count(0)
    run = the_run(lab, "Cut-off")
    assert len(read_samples(run.folder)) == int(count)
    check(lab, run)
    assert len([url for url in again if url.endswith(".jpg")]) == int(count) - 2
    assert not set(sent) & set(again)


@pytest.mark.extended
def test_a_tab_that_was_closed_leaves_samples_that_another_may_upload_or_delete(
    open_page: OpenPage, lab: PageLab
) -> None:
    page = open_page(SCENE, url=lab.url)
    begin(page, "Closed", "20")
    play(page, 4 * EVERY)
    other = page.context.new_page()
    other.goto(f"{lab.url}#/experiments")
    expect(left(other)).to_contain_text("In use by another tab")
    expect(left(other).get_by_role("button")).to_have_count(0)
    page.close(run_before_unload=False)
    other.reload()
    expect(left(other).get_by_role("button", name="Delete")).to_be_visible()
    left(other).get_by_role("button", name="Upload").click()
    expect(left(other)).to_have_count(0)
    run = the_run(lab, "Closed")
    assert (run.record.status, run.record.problem) == (
        "failed",
        "The page was closed before the run's end; only its samples are left.",
    )
    assert len(read_samples(run.folder)) >= 3
    check(lab, run)


def limit_storage(page: Page, lab: PageLab, size: int) -> None:
    """As on a disk that is almost full."""
    quota = {"origin": lab.url.rstrip("/"), "quotaSize": size}
    page.context.new_cdp_session(page).send("Storage.overrideQuotaForOrigin", quota)


@pytest.mark.slow
@pytest.mark.extended
def test_a_disk_that_fills_up_ends_sampling_and_neither_the_run_nor_what_was_kept(
    open_page: OpenPage, lab: PageLab
) -> None:
    page = open_page(SCENE, url=lab.url)
    begin(page, "Filled up", "5")
    play(page, 2 * EVERY)
    limit_storage(page, lab, 1)
    remark = remarks(page)
    expect(remark).to_contain_text("The browser’s storage is full. Sampling ended after")
    expect(outcome(page)).to_contain_text("All runs are complete.", timeout=STORED_MS)
    run = the_run(lab, "Filled-up")
    assert run.record.status == "complete"
    assert f"after {len(read_samples(run.folder))} frames." in remark.inner_text()
    check(lab, run)
