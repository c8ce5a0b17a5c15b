"""Any fault in a request's body is reported in one sentence."""

from __future__ import annotations

import json
from typing import Any

import pytest

from tigas_common.errors import BodyTooLarge, InvalidRequest, UnknownScene, problem
from tigas_common.parsing import MAX_BODY, parse
from tigas_common.wire.render import DEFAULT_LADDER, RenderRequest

EULER: dict[str, Any] = {
    **{"scene": "garden", "seq": 3, "azimuth": 10, "elevation": -5.5, "translation": [0, 1, 2]},
    **{"fx": 500, "fy": 500, "cx": 320, "cy": 180, "width": 640, "height": 360, "profile": 2},
}
QUATERNION = {key: value for key, value in EULER.items() if key not in ("azimuth", "elevation", "translation")} | {
    "position": [0, 1, 2],
    "quaternion": [0, 0, 0, 1],
}


def body(fields: dict[str, Any], **changes: Any) -> bytes:
    """The fields as JSON; a change to ... leaves a field out."""
    changed = fields | changes
    return json.dumps({key: value for key, value in changed.items() if value is not ...}).encode()


def test_both_forms_of_pose_are_understood() -> None:
    assert parse(RenderRequest, body(EULER)).pose.position == (0, 1, 2)
    assert parse(RenderRequest, body(QUATERNION)).pose.rotation == ((1, 0, 0), (0, 1, 0), (0, 0, 1))
    assert parse(RenderRequest, body(EULER, profile=..., seq=...)).format == "jpeg"


@pytest.mark.parametrize(
    ("raw", "says"),
    [
        (b"", "JSON"),
        (b"not json", "JSON"),
        (b"\xff\xfe\x00", "JSON"),
        (b"[" * 10_000, "JSON"),
        (b"[]", "object"),
        (b"3", "object"),
        (b"{}", "scene"),
        (body(EULER, fx=...), "fx"),
        (body(EULER, fx="500"), "fx"),
        (body(EULER, fx=0), "fx"),
        (body(EULER, fx=-1), "fx"),
        (body(EULER, fx=float("nan")), "fx"),
        (body(EULER, fx=float("inf")), "fx"),
        (body(EULER, fx=1e308), "fx"),
        (body(EULER, azimuth=1e308), "azimuth"),
        (body(EULER, translation=[0, 0]), "translation"),
        (body(EULER, translation=[0, 0, float("nan")]), "translation"),
        (body(EULER, translation=[0, 0, 1e308]), "translation"),
        (body(EULER, width=0), "width"),
        (body(EULER, width=640.5), "width"),
        (body(EULER, width=True), "width"),
        (body(EULER, width=100_000, height=100_000), "width"),
        (body(EULER, width=8192, height=8192), "pixels"),
        (body(EULER, seq=-1), "seq"),
        (body(EULER, seq=2**32), "seq"),
        (body(EULER, profile="best"), "profile"),
        (body(EULER, format="gif"), "format"),
        (body(EULER, deadline_ms=0), "deadline_ms"),
        (body(EULER, scene=None), "scene"),
        (body(EULER, scene="x" * 300), "scene"),
        (body(EULER, wheels=4), "wheels"),
        (body(EULER, position=[0, 0, 0]), "either"),
        (body(EULER, translation=...), "together"),
        (body(QUATERNION, quaternion=...), "together"),
        (body(QUATERNION, quaternion=[0, 0, 0, 0]), "length zero"),
        (body(EULER, azimuth=..., elevation=..., translation=...), "either"),
        (b'{"fx": 1, "fx": 2', "JSON"),
    ],
)
def test_a_wrong_body_gets_one_sentence_that_names_what_is_wrong(raw: bytes, says: str) -> None:
    with pytest.raises(InvalidRequest) as caught:
        parse(RenderRequest, raw)
    detail = caught.value.detail
    assert says in detail
    assert detail.endswith(".")
    assert "\n" not in detail
    assert len(detail) < 200


def test_a_body_over_the_limit_is_refused() -> None:
    with pytest.raises(BodyTooLarge):
        parse(RenderRequest, b" " * (MAX_BODY + 1))


def test_a_problem_tells_what_a_client_may_know() -> None:
    known = problem(UnknownScene("There is no scene 'x'."))
    assert (known.status, known.type, known.detail) == (404, "tigas:unknown-scene", "There is no scene 'x'.")
    unknown = problem(RuntimeError("secret of the inside"))
    assert unknown.status == 500
    assert "secret" not in unknown.model_dump_json()


@pytest.mark.parametrize("rung", DEFAULT_LADDER)
def test_a_rung_keeps_its_resolution_for_its_own_shape_and_its_pixels_for_others(rung: Any) -> None:
    assert rung.size_for(1920, 1080) == (rung.width, rung.height)
    width, height = rung.size_for(390, 844)
    assert width * height == pytest.approx(rung.width * rung.height, rel=0.01)
    assert width / height == pytest.approx(390 / 844, rel=0.01)
    for extreme in (rung.size_for(8192, 1), rung.size_for(1, 8192), rung.size_for(1, 1)):
        assert all(1 <= side <= 8192 for side in extreme)


def test_very_many_mistakes_are_counted_and_not_listed() -> None:
    raw = body(EULER, **{f"wheel{number}": 4 for number in range(5000)})
    with pytest.raises(InvalidRequest, match="There are 5,000 errors"):
        parse(RenderRequest, raw, len(raw))


def test_names_that_nobody_knows_are_told_on_one_short_line() -> None:
    for name in ("a" * 10_000, "\x1b[2J\n", "\u202egpj"):
        with pytest.raises(InvalidRequest) as failure:
            parse(RenderRequest, body(EULER, **{name: 1}))
        assert failure.value.detail.isprintable()
        assert len(failure.value.detail) < 200
