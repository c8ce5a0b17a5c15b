"""The samples of a stored experiment in the page: rendered again when asked, and shown beside ground truth."""

from __future__ import annotations

import io
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Locator, expect

from tests.experiments.samples.real_frames import sample_run
from tests.experiments.store.conftest import by_command
from tests.prerequisites import BUILT_PAGE
from tests.web.conftest import OpenPage
from tests.web.server import RenderServer, Store
from tigas_experiments.quality.picture import Picture
from tigas_experiments.records.samples import JPEG, TRUTH, sample_path, write_sample_file


@dataclass(frozen=True)
class Lab:
    """A viewer whose store has an experiment with two sampled runs; one frame of the second is another's."""

    url: str
    runs: Path


@pytest.fixture
def lab(server: RenderServer, models: Path, tmp_path: Path) -> Iterator[Lab]:
    BUILT_PAGE.require()
    runs = by_command(tmp_path / "results" / "mine", 1) / "runs"
    sample_run(server, runs / "first", repeat=1)
    sample_run(server, runs / "second", repeat=2)
    write_sample_file(runs / "second", 3, JPEG, sample_path(runs / "second", 40, JPEG).read_bytes())
    render = server.url.rstrip("/")
    with Store("--results", str(tmp_path / "results"), render=render) as store:
        services = {"TIGAS_RENDER_SERVICES": json.dumps({"store": store.url})}
        with RenderServer("--scenes", str(models), environment=services) as viewer:
            yield Lab(viewer.url, runs)


def pixels(of: Locator) -> Picture:
    """As the browser shows it."""
    return np.asarray(Image.open(io.BytesIO(of.screenshot())).convert("RGB"))


def test_samples_are_rendered_again_and_shown_beside_ground_truth(lab: Lab, open_page: OpenPage) -> None:
    page = open_page("#/experiments", url=lab.url)
    page.get_by_role("link", name="Samples").click()
    expect(page.get_by_text("0 of 6 have ground truth")).to_be_visible()
    page.get_by_role("button", name="Render ground truth").click()
    expect(page.get_by_text("6 of 6 have ground truth")).to_be_visible()
    expect(page.get_by_role("row", name="first").get_by_role("cell")).to_have_text(["3", "3", "0", "0"])
    second = page.get_by_role("row", name="second")
    expect(second.get_by_role("cell")).to_have_text(["3", "2", "1", "0"])

    gallery = page.get_by_role("region", name="Samples")
    expect(gallery.get_by_role("combobox", name="Right")).to_have_value("truth")
    expect(gallery.get_by_role("img", name="Ground truth")).to_have_count(2)
    wipe, at = gallery.locator(".wipe"), gallery.get_by_role("slider")
    at.fill("0")
    truth = pixels(wipe)
    reference = Image.open(sample_path(lab.runs / "first", 8, TRUTH)).convert("RGB")
    shown = np.asarray(Image.fromarray(truth).resize(reference.size))
    assert np.abs(shown.astype(int) - np.asarray(reference)).mean() < 8, "sample 8 is the first of the run"
    at.fill("100")
    assert (pixels(wipe) != truth).any(), "the slider shows the frame"
    gallery.get_by_role("combobox", name="Left").select_option("original-difference")
    difference = pixels(wipe)
    assert difference.mean() < truth.mean() / 2, "frame and ground truth are alike"
    assert difference.max() > 0

    second.get_by_role("radio").check()
    gallery.get_by_role("combobox", name="Sample").select_option("3")
    expect(gallery.get_by_role("alert")).to_contain_text("Rendering it again gave a different frame")
    gallery.get_by_role("combobox", name="Left").select_option("replayed")
    gallery.get_by_role("button", name="Next").click()
    expect(gallery.get_by_role("combobox", name="Sample")).to_have_value("40")
    expect(gallery.get_by_role("alert")).to_have_count(0)
