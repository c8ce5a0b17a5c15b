"""Each service describes itself, and what it answers is what it describes."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import httpx
import pytest
from jsonschema import Draft202012Validator
from openapi_spec_validator import validate

from tests.every_service import SERVICES

pytestmark = pytest.mark.anyio

ASKED = {
    "render": ("/scenes", "/config.json", "/api/load", "/scenes/courtyard", "/scenes/none"),
    "dash": ("/sessions", "/sessions/none"),
    "shaper": ("/traces", "/status", "/traces/none"),
    "store": ("/experiments", "/movements", "/experiments/none"),
}


def documented(document: dict[str, Any], path: str) -> Any:
    """The path as the document has it."""
    here = path.strip("/").split("/")
    return next(
        known
        for known in sorted(document["paths"], key=lambda known: known.count("{"))
        if len(parts := known.strip("/").split("/")) == len(here)
        and all(part.startswith("{") or part == given for part, given in zip(parts, here, strict=True))
    )


@pytest.mark.parametrize("name", ASKED)
async def test_a_services_description_is_valid_and_true_and_its_root_lists_it(name: str, tmp_path: Path) -> None:
    async with (
        SERVICES[name](tmp_path) as app,
        httpx.AsyncClient(transport=httpx.ASGITransport(app), base_url="http://localhost") as client,
    ):
        document = (await client.get("/openapi.json")).json()
        answers = {path: await client.get(path) for path in ASKED[name]}
        root = await client.get("/")
    validate(document)
    for path, answer in answers.items():
        responses = document["paths"][documented(document, path)]["get"]["responses"]
        said = responses["2XX" if answer.is_success else "default"]["content"][answer.headers["content-type"]]
        Draft202012Validator(said["schema"] | {"components": document["components"]}).validate(answer.json())
    if name != "render":  # which has the page there
        assert root.status_code == 200, "the address that a service prints answers"
        listed = {line.split()[1] for line in root.text.splitlines() if re.match(r"[A-Z]+ +/", line)}
        assert listed == document["paths"].keys() - {"/"}
        assert all(line.strip() for line in root.text.splitlines()[2:]), "a route without a docstring"


async def test_requests_are_described_with_all_that_they_may_have(tmp_path: Path) -> None:
    async with (
        SERVICES["render"](tmp_path) as app,
        httpx.AsyncClient(transport=httpx.ASGITransport(app), base_url="http://localhost") as client,
    ):
        document = (await client.get("/openapi.json")).json()
    render = document["paths"]["/render"]["post"]
    assert render["summary"] == "One frame."
    reference = render["requestBody"]["content"]["application/json"]["schema"]["$ref"]
    request = document["components"]["schemas"][reference.rpartition("/")[2]]
    assert {"scene", "position", "quaternion", "profile"} <= request["properties"].keys()
    assert set(request["required"]) == {"scene", "fx", "fy", "cx", "cy", "width", "height"}
    scene = document["paths"]["/scenes/{id}"]["get"]["parameters"]
    assert [(each["name"], each["in"]) for each in scene] == [("id", "path")]
