"""Each service has an API description, which matches its requests and answers."""

from __future__ import annotations

import asyncio
import json
import re
import threading
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest
from jsonschema import Draft202012Validator
from openapi_spec_validator import validate

from tests.every_service import client_of
from tests.experiments.store.conftest import plan, upload
from tests.experiments.store.test_sample_uploads import JPEG, PNG, index
from tests.render.fakes import render_request
from tigas_common import openapi

pytestmark = pytest.mark.anyio

PAGE = {"Origin": "http://localhost:8080"}


def documented(document: dict[str, Any], path: str) -> Any:
    """The path as the document has it."""
    here = path.strip("/").split("/")
    return next(
        known
        for known in sorted(document["paths"], key=lambda known: known.count("{"))
        if len(parts := known.strip("/").split("/")) == len(here)
        and all(part.startswith("{") or part == given for part, given in zip(parts, here, strict=True))
    )


def check(document: dict[str, Any], content: dict[str, Any], media: str, body: bytes) -> None:
    """That a body is of a media type that the document names, and fits the schema there, if it has one."""
    described = content[media.partition(";")[0]]
    if schema := described.get("schema"):
        Draft202012Validator(schema | {"components": document["components"]}).validate(json.loads(body))


def check_exchange(document: dict[str, Any], answer: httpx.Response) -> None:
    """The request is described, and so is this answer."""
    request = answer.request
    operation = document["paths"][documented(document, request.url.path)][request.method.lower()]
    parameters = {each["name"] for each in operation["parameters"] if each["in"] == "query"}
    assert set(request.url.params) <= parameters
    if request.content and answer.status_code not in (400, 422):
        check(document, operation["requestBody"]["content"], request.headers["content-type"], request.content)
    responses = operation["responses"]
    said = responses.get(str(answer.status_code)) or responses["2XX" if answer.is_success else "default"]
    if answer.content:
        check(document, said["content"], answer.headers["content-type"], answer.content)
    else:
        assert "content" not in said


@asynccontextmanager
async def asking(name: str, folder: Path) -> AsyncIterator[tuple[httpx.AsyncClient, dict[str, Any]]]:
    """A client that checks every request and answer against the service's description."""

    async def compare(answer: httpx.Response) -> None:
        if answer.request.url.path != "/openapi.json":
            await answer.aread()
            check_exchange(document, answer)

    async with client_of(name, folder, headers=PAGE, event_hooks={"response": [compare]}) as client:
        document = (await client.get("/openapi.json")).json()
        yield client, document


async def ask_render(client: httpx.AsyncClient) -> list[httpx.Response]:
    body = render_request(scene="none").model_dump(mode="json", exclude_unset=True)
    assert (await client.post("/render", json=body)).status_code == 404
    paths = ("/scenes?scan=1", "/config.json", "/api/load", "/scenes/courtyard", "/healthz", "/metrics")
    return [await client.get(path) for path in (*paths, "/enhance/general.safetensors")]


async def ask_dash(client: httpx.AsyncClient) -> list[httpx.Response]:
    return [await client.get(path) for path in ("/", "/sessions", "/time", "/healthz")]


async def ask_shaper(client: httpx.AsyncClient) -> list[httpx.Response]:
    trace = b"t_ms,down_kbps\n0,5000\n1000,4000\n"
    sent = {"Content-Type": "application/octet-stream"}
    added = await client.post("/traces?name=steps.csv", content=trace, headers=sent)
    assert added.is_success, added.text
    name = added.json()["name"]
    return [
        *[await client.get(path) for path in ("/", "/traces", f"/traces/{name}", "/status", "/healthz")],
        await client.post("/start", json={"trace": name, "loop": True}),
        await client.post("/seek", json={"position_ms": 500}),
        await client.post("/stop"),
        await client.post("/link", json={"down_kbps": 8000, "up_kbps": 4000, "delay_ms": 50}),
    ]


async def ask_store(client: httpx.AsyncClient) -> list[httpx.Response]:
    summary = await client.post("/plans", json=plan())
    created = await client.post("/experiments", json=plan())
    experiment = f"/experiments/{created.json()['id']}"
    reserved = await client.post(f"{experiment}/next", json={"page": "a", "begin": True})
    run = f"{experiment}/runs/{reserved.json()['job']['run']}"
    kept = await client.put(run, json=upload())
    capture = await client.put(f"{run}/captures/0000.png", content=PNG, headers={"Content-Type": "image/png"})
    completed = await client.post(f"{run}/complete")
    released = await client.delete(f"{experiment}/pages/a")
    samples = f"{run}/samples"
    picture = await client.put(f"{samples}/000003.jpg", content=JPEG, headers={"Content-Type": "image/jpeg"})
    complete = await client.put(samples, json=index(3))
    paths = (experiment, samples, f"{samples}/000003.jpg", f"{experiment}/zip", "/experiments", "/movements", "/")
    asked = [await client.get(path) for path in paths]
    made = [summary, created, reserved, kept, capture, completed, released, picture, complete]
    return [*made, *asked, await client.delete(experiment)]


async def ask_director(client: httpx.AsyncClient) -> list[httpx.Response]:
    answers = [await client.get(path) for path in ("/config.json?scene=garden&at=here", "/healthz", "/metrics")]
    elsewhere = await client.post("/render", json=render_request().model_dump(mode="json", exclude_unset=True))
    assert elsewhere.status_code == 307
    return answers


ASK: dict[str, Callable[[httpx.AsyncClient], Awaitable[list[httpx.Response]]]] = {
    "render": ask_render,
    "dash": ask_dash,
    "shaper": ask_shaper,
    "store": ask_store,
    "director": ask_director,
}
REFUSED = {
    "render": "/scenes/none",
    "dash": "/sessions/none",
    "shaper": "/traces/none",
    "store": "/experiments/none",
    "director": f"/config.json?scene={'x' * 999}",
}


@pytest.mark.parametrize("name", ASK)
async def test_a_services_description_is_valid_and_true(name: str, tmp_path: Path) -> None:
    async with asking(name, tmp_path) as (client, document):
        validate(document)
        for answer in await ASK[name](client):
            assert answer.is_success, answer.text
        refused = await client.get(REFUSED[name])
        assert refused.headers["content-type"] == "application/problem+json"


@pytest.mark.parametrize("name", ["dash", "shaper", "store"])
async def test_a_services_root_lists_what_it_describes(name: str, tmp_path: Path) -> None:
    async with asking(name, tmp_path) as (client, document):
        root = await client.get("/")
    assert root.status_code == 200, "the address that a service prints answers"
    listed = {line.split()[1] for line in root.text.splitlines() if re.match(r"[A-Z]+ +/", line)}
    assert listed == document["paths"].keys() - {"/"}
    assert all(line.strip() for line in root.text.splitlines()[2:]), "a route without a docstring"


@pytest.mark.parametrize("name", ASK)
async def test_a_description_is_made_once_and_sent_once(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[int] = []

    def describe(*_: object) -> dict[str, Any]:
        made.append(threading.get_ident())
        return {}

    monkeypatch.setattr(openapi, "describe", describe)
    async with client_of(name, tmp_path) as client:
        answers = await asyncio.gather(*(client.get("/openapi.json") for _ in range(20)))
        assert {answer.status_code for answer in answers} == {200}
        tag = answers[0].headers["ETag"]
        again = await client.get("/openapi.json", headers={"If-None-Match": tag})
    assert (again.status_code, again.content, again.headers["ETag"]) == (304, b"", tag)
    assert len(made) == 1
    assert made != [threading.get_ident()], "the event loop waited for it"


async def test_requests_are_described_with_all_that_they_may_have(tmp_path: Path) -> None:
    async with asking("render", tmp_path) as (_, document):
        render = document["paths"]["/render"]["post"]
        assert render["summary"] == "One frame."
        reference = render["requestBody"]["content"]["application/json"]["schema"]["$ref"]
        request = document["components"]["schemas"][reference.rpartition("/")[2]]
        assert {"scene", "position", "quaternion", "profile"} <= request["properties"].keys()
        assert set(request["required"]) == {"scene", "fx", "fy", "cx", "cy", "width", "height"}
        scene = document["paths"]["/scenes/{id}"]["get"]["parameters"]
        assert [(each["name"], each["in"]) for each in scene] == [("id", "path")]
