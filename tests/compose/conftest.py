"""The containers, started once, and a page of theirs in a browser."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Page, sync_playwright

from tests.compose.stack import Stack
from tests.prerequisites import CHROMIUM, DOCKER
from tests.web.conftest import CHROMIUM_ARGS, DESKTOP, PATIENCE
from tests.web.scenes import write_scenes


def models_of_tests(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A models directory with a small scene."""
    DOCKER.require()
    models = tmp_path_factory.mktemp("models")
    models.chmod(0o755)  # the container's user is another one
    write_scenes(models)
    return models


# For a module each: they publish the same ports.
@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stack]:
    """The stack with a small scene, built and healthy; removed at the end, whatever happens."""
    stack = Stack(models_of_tests(tmp_path_factory))
    with stack.running():
        yield stack


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stack]:
    """The cluster, with synthetic frames."""
    stack = Stack(models_of_tests(tmp_path_factory), file="compose.cluster.yaml", TIGAS_DEVICE="instant:5000")
    with stack.running():
        yield stack


@pytest.fixture
def stack(running: Stack) -> Stack:
    """The stack, whole again and with a fast link, whatever the test before did to it."""
    running.up()
    running.set_link(down_kbps=50_000, up_kbps=20_000)
    return running


@pytest.fixture
def page() -> Iterator[Page]:
    """An empty page."""
    CHROMIUM.require()
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=CHROMIUM_ARGS)
        made = browser.new_page(viewport=DESKTOP)
        made.set_default_timeout(2 * PATIENCE)
        yield made
        browser.close()
