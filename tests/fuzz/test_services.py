"""Any request to a service is answered, or refused in one sentence."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from typing import Any

import psutil
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.every_service import SERVICES
from tests.experiments.store.conftest import slug
from tests.fuzz.asgi import HOST, Answer, ask, assert_answered, opened
from tests.fuzz.byte_edits import chunked
from tests.fuzz.fuzzers import effort, found
from tests.fuzz.json_texts import bodies, dumps
from tests.fuzz.targets import METHODS, headers, paths
from tests.fuzz.test_traces import files as trace_files
from tests.fuzz.wire_examples import EXAMPLES
from tigas_common.wire.dash import SessionRequest
from tigas_common.wire.render import RenderRequest
from tigas_common.wire.shaper import LinkSetting, LoopRequest, SeekRequest, StartRequest
from tigas_experiments.wire.store import ExperimentRequest, NextRequest, RunUpload, SampleIndex

PAGE = (b"origin", b"http://localhost:8080")
MOST_GROWTH = 300_000_000
"""Bytes that a service may take for all that it is sent here."""

Ask = Callable[..., Answer]


def asking(context: Any) -> Iterator[Ask]:
    """Asks an application that is open as long as the generator is, and watches its memory."""
    with opened(context) as (app, run):

        def ask_it(method: str, path: str, **request: Any) -> Answer:
            answer: Answer = run(ask(app, method, path, **request))
            return answer

        ask_it("GET", "/healthz")
        before = psutil.Process().memory_info().rss
        yield ask_it
        assert ask_it("GET", "/healthz").status == 200
        assert psutil.Process().memory_info().rss - before < MOST_GROWTH


def service(name: str) -> Any:
    """A fixture that asks a service."""

    @pytest.fixture(scope="module", name=name)
    def asked(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Ask]:
        yield from asking(SERVICES[name](tmp_path_factory.mktemp(name)))

    return asked


render, director, dash, shaper, store = map(service, ("render", "director", "dash", "shaper", "store"))


@effort(100)
@given(bodies(RenderRequest, EXAMPLES[RenderRequest]))
def test_any_render_request_is_answered(render: Ask, body: bytes) -> None:
    answer = render("POST", "/render", chunks=[body])
    assert_answered(answer, "deadline-exceeded")
    assert answer.status < 400 or answer.status == 504 or b"tigas:" in answer.body


@effort(30)
@given(body=bodies(SessionRequest, EXAMPLES[SessionRequest]))
@found("session", body=bytes)
def test_any_session_is_opened_played_and_ended_or_refused_and_forgotten(dash: Ask, body: bytes) -> None:
    answer = dash("POST", "/sessions", chunks=[body])
    assert_answered(answer, "encoder-unavailable")
    if answer.status == 201:
        session = json.loads(answer.body)
        assert_answered(dash("GET", session["manifest"]))
        for one in session["representations"]:
            assert_answered(dash("GET", f"/sessions/{session['id']}/{one['id']}/init.mp4"))
        assert dash("DELETE", f"/sessions/{session['id']}").status == 204
    assert json.loads(dash("GET", "/sessions").body) == []


@pytest.mark.parametrize(
    ("path", "kind"),
    [("/start", StartRequest), ("/seek", SeekRequest), ("/loop", LoopRequest), ("/link", LinkSetting)],
)
def test_any_change_of_the_link_is_made_or_refused(shaper: Ask, path: str, kind: Any) -> None:
    @effort(30)
    @given(bodies(kind, EXAMPLES[kind]))
    def fuzz(body: bytes) -> None:
        assert_answered(shaper("POST", path, chunks=[body], headers=[HOST, PAGE]))
        assert shaper("GET", "/status").status == 200

    fuzz()


@effort(50)
@given(trace_files, paths(["/traces"]))
def test_any_trace_is_taken_or_refused(shaper: Ask, data: bytes, path: str) -> None:
    answer = shaper("POST", path, chunks=[data], headers=[HOST, PAGE])
    assert_answered(answer)
    if answer.status == 200:
        assert shaper("GET", f"/traces/{json.loads(answer.body)['name']}").status == 200
    assert_answered(shaper("GET", "/traces"))


@pytest.fixture(scope="module")
def experiment(store: Ask) -> str:
    """The path of an experiment."""
    (example, *_) = EXAMPLES[ExperimentRequest]
    answer = store("POST", "/experiments", chunks=[dumps(example).encode()])
    assert answer.status == 201
    return answer.headers[b"location"].decode()


@effort(100)
@given(bodies(ExperimentRequest, EXAMPLES[ExperimentRequest]))
def test_any_experiment_is_begun_or_refused(store: Ask, body: bytes) -> None:
    answer = store("POST", "/experiments", chunks=[body])
    assert_answered(answer)
    if answer.status == 201:
        location = answer.headers[b"location"].decode()
        assert_answered(store("GET", location))
        assert store("DELETE", location).status == 204


@effort(20)
@given(st.data())
def test_any_run_is_kept_or_refused(store: Ask, experiment: str, data: st.DataObject) -> None:
    body = data.draw(bodies(RunUpload, EXAMPLES[RunUpload]))
    answer = store("PUT", f"{experiment}/runs/{slug('dash-tuned')}", chunks=data.draw(chunked(body)))
    assert_answered(answer)
    if answer.status == 200:
        assert_answered(store("GET", experiment))
        assert_answered(store("GET", "/experiments"))
        assert store("GET", f"{experiment}/zip").body[:2] == b"PK"


@pytest.fixture(scope="module")
def run(store: Ask, experiment: str) -> str:
    """The path of a run that has no samples yet."""
    run = f"{experiment}/runs/{slug()}"
    assert store("PUT", run, chunks=[dumps(EXAMPLES[RunUpload][0]).encode()]).status == 200
    return run


@effort(50)
@given(st.sampled_from(["000007.jpg", "000007.enhanced.webp", "000007.enhanced.png", "x"]), st.binary(max_size=100))
def test_any_picture_of_a_sample_is_kept_or_refused(store: Ask, run: str, name: str, body: bytes) -> None:
    assert_answered(store("PUT", f"{run}/samples/{name}", chunks=[body]))
    assert_answered(store("GET", f"{run}/uploaded-samples"))


@effort(50)
@given(st.sampled_from([SampleIndex, NextRequest, ExperimentRequest]), st.data())
def test_any_other_message_is_answered(store: Ask, experiment: str, run: str, kind: Any, data: st.DataObject) -> None:
    method, path = {
        SampleIndex: ("PUT", f"{run}/samples"),
        NextRequest: ("POST", f"{experiment}/next"),
        ExperimentRequest: ("POST", "/plans"),
    }[kind]
    assert_answered(store(method, path, chunks=[data.draw(bodies(kind, EXAMPLES[kind]))]))


TARGETS = {
    "render": "/ /render /scenes /scenes/{} /scenes/scene/{} /scenes/{}/{} /config.json /assets/{} /{}",
    "director": "/ /render /scenes /scenes/scene/{} /scenes/{}/unload /config.json?scene={}&{}={} /metrics /{}",
    "dash": "/sessions /sessions/{} /sessions/{}/{} /sessions/{}/{}/init.mp4 /sessions/{}/{}/{}.m4s /time",
    "shaper": "/traces /traces/{} /start /stop /pause /resume /status /healthz /{}",
    "store": "/experiments /experiments/{} /experiments/{}/{} /experiments/{}/report /movements/{} /{}",
}


@pytest.mark.parametrize("service", TARGETS)
def test_any_target_is_answered(service: str, request: pytest.FixtureRequest) -> None:
    asked: Ask = request.getfixturevalue(service)

    page = [PAGE] if service == "shaper" else []

    @effort(100)
    @given(st.sampled_from(METHODS), paths(TARGETS[service].split()), headers(HOST[1], *page))
    def fuzz(method: str, path: str, fields: list[tuple[bytes, bytes]]) -> None:
        assert_answered(asked(method, path, headers=fields))

    fuzz()
