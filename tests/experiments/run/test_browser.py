"""A page that misbehaves gets a sentence and never holds up the runs after it."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path
from typing import Any

import pytest
from playwright.async_api import Error, TimeoutError

from tests.experiments.made_up import SERVER, configuration
from tigas_experiments.errors import RunFailed
from tigas_experiments.run import browser
from tigas_experiments.run.browser import Viewer, graphics_arguments, http3_arguments, is_responsive
from tigas_experiments.run.job import run_plan


class StrangePage:
    """Answers to a name with a value, with an error, or, for ..., never."""

    def __init__(self, **answers: Any) -> None:
        self.answers = answers

    async def evaluate(self, _: str, argument: list[str]) -> str:
        answer = self.answers.get(argument[0])
        if answer is ...:
            await asyncio.sleep(3600)
        if isinstance(answer, Exception):
            raise answer
        return json.dumps(answer)

    async def wait_for_function(self, *_: object, **__: object) -> None:
        if error := self.answers.get("wait"):
            raise error


def prepared(**answers: Any) -> None:
    """Prepare a run in such a page."""
    page: Any = StrangePage(**answers)
    asyncio.run(Viewer(page).prepare({}, {}))


@pytest.mark.parametrize(
    ("answers", "sentence"),
    [
        ({"settings": Error("Target crashed\nat x")}, r"^The viewer failed: Target crashed$"),
        ({"stand": Error("")}, r"^The viewer failed: no reason given$"),
        ({"settings": ...}, r"^The viewer did not answer within 0.05 s \(settings\)\.$"),
        (
            {"wait": TimeoutError("late"), "state": {"ready": False}},
            r'showed no frame within 60 s: \{"ready": false\}$',
        ),
        ({"wait": TimeoutError("late"), "state": ...}, r"showed no frame within 60 s: The viewer did not answer"),
    ],
)
def test_a_page_that_misbehaves_gets_a_sentence(
    monkeypatch: pytest.MonkeyPatch, answers: dict[str, Any], sentence: str
) -> None:
    monkeypatch.setattr(browser.Viewer._call, "__defaults__", (0.05,))
    prepared()
    with pytest.raises(RunFailed, match=sentence):
        prepared(**answers)


def test_a_recording_is_waited_for_as_long_as_it_may_take() -> None:
    page: Any = StrangePage(run=...)
    with pytest.raises(RunFailed, match=r"did not answer within 0.05 s \(run\)"):
        asyncio.run(Viewer(page).record(run_plan(configuration(), []), 0.05))


@pytest.mark.parametrize("answer", [Error("Connection closed"), ...], ids=["dead", "hanging"])
def test_a_browser_that_does_not_respond_is_told_from_one_that_does(
    monkeypatch: pytest.MonkeyPatch, answer: object
) -> None:
    class Session:
        async def send(self, _: str) -> None:
            pass

        async def detach(self) -> None:
            pass

    class Browser:
        def __init__(self, answer: object) -> None:
            self.answer = answer

        async def new_browser_cdp_session(self) -> Session:
            if self.answer is ...:
                await asyncio.sleep(3600)
            if isinstance(self.answer, Exception):
                raise self.answer
            return Session()

    def found(answer: object) -> bool:
        strange: Any = Browser(answer)
        return asyncio.run(is_responsive(strange))

    monkeypatch.setattr(browser, "CLOSE_S", 0.05)
    assert found(None)
    assert not found(answer)


def test_the_browser_takes_http3_of_a_server_by_its_key() -> None:
    server = SERVER.model_copy(
        update={"public_key_sha256": "a+b/c=", "dash_h3_url": "https://[::1]:4433/services/dash"}
    )
    assert http3_arguments(server) == (
        "--origin-to-force-quic-on=[::1]:4433",
        "--ignore-certificate-errors-spki-list=a+b/c=",
    )
    assert http3_arguments(SERVER) == ()


HARDWARE = {"--use-angle=vulkan", "--enable-features=Vulkan", "--ignore-gpu-blocklist"}
SOFTWARE = {"--enable-features=Vulkan", "--use-vulkan=swiftshader", "--use-angle=swiftshader"}
WEBGPU = {"--enable-unsafe-webgpu"}
HARDWARE_WEBGPU = {*WEBGPU, "--disable-vulkan-surface"}


@pytest.mark.parametrize(
    ("devices", "webgpu", "arguments"),
    [
        (["nvidia0"], False, HARDWARE),
        (["dri/renderD128", "dri/card0"], True, HARDWARE | HARDWARE_WEBGPU),
        (["dri/card0"], True, SOFTWARE | WEBGPU),
        (["nvidiactl"], False, set()),
    ],
)
def test_the_browser_draws_with_the_graphics_processor_where_there_is_one(
    tmp_path: Path, devices: list[str], webgpu: bool, arguments: set[str]
) -> None:
    for name in devices:
        device = tmp_path / name
        device.parent.mkdir(exist_ok=True)
        device.touch()
    assert set(graphics_arguments(webgpu=webgpu, devices=tmp_path)) == arguments
