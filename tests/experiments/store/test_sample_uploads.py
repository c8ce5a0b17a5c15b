"""Samples that a page uploads: picture by picture, and complete at once; cut off, resumed, and refused."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import pytest
from PIL import Image

from tests.experiments.made_up import sampled
from tests.experiments.store.conftest import Running, by_command, slug
from tigas_experiments.records.samples import enhanced_path, read_sample_file, read_samples, sample_path
from tigas_experiments.store import app, samples

pytestmark = pytest.mark.anyio


def picture(kind: str, shade: int = 7) -> bytes:
    """A small one, lossless unless it is a JPEG."""
    buffer = io.BytesIO()
    options = {"lossless": True} if kind == "WEBP" else {}
    Image.new("RGB", (64, 36), (shade, 2, 3)).save(buffer, kind, **options)
    return buffer.getvalue()


JPEG, WEBP, PNG = picture("JPEG"), picture("WEBP"), picture("PNG")


async def begun(store: Running) -> str:
    experiment = await store.create()
    row = await store.add(experiment)
    return f"/experiments/{experiment}/runs/{row['folder']}"


def index(*seqs: int, enhanced: bool = False, **changes: Any) -> dict[str, Any]:
    """Of samples of these numbers, all of which have the same pictures."""
    made = [sampled(seq, bytes=len(JPEG), enhanced=enhanced, **changes) for seq in seqs]
    return {"samples": [sample.model_dump(mode="json", exclude_none=True) | {"rung": 2} for sample in made]}


async def put(store: Running, run: str, name: str, content: bytes) -> tuple[int, str]:
    """The status, and the text of a refusal."""
    answer = await store.http.put(f"{run}/samples/{name}", content=content)
    return answer.status_code, "" if answer.status_code == 204 else answer.json()["detail"]


async def test_samples_come_picture_by_picture_and_are_there_once_all_are(store: Running) -> None:
    run = await begun(store)
    folder = store.results.joinpath(*run.split("/")[2:])
    assert (await store.http.get(f"{run}/uploaded-samples")).json() == {"complete": False, "files": []}
    for name, content in (("000003.jpg", JPEG), ("000003.enhanced.webp", WEBP), ("000009.jpg", JPEG)):
        assert await put(store, run, name, content) == (204, "")
    told = (await store.http.get(f"{run}/uploaded-samples")).json()
    assert told["files"] == [
        {"name": "000003.enhanced.webp", "bytes": len(WEBP)},
        {"name": "000003.jpg", "bytes": len(JPEG)},
        {"name": "000009.jpg", "bytes": len(JPEG)},
    ]
    early = await store.http.put(f"{run}/samples", json=index(3, 9, enhanced=True))
    assert (early.status_code, early.json()["detail"]) == (400, "000009.enhanced.webp is missing.")
    assert read_samples(folder) == []
    assert await put(store, run, "000009.enhanced.png", PNG) == (204, "")
    assert (await store.http.put(f"{run}/samples", json=index(3, 9, enhanced=True))).status_code == 204
    assert [sample.seq for sample in read_samples(folder)] == [3, 9]
    assert read_sample_file(sample_path(folder, 3, "jpg")) == JPEG
    assert [path and path.name for path in (enhanced_path(folder, 3), enhanced_path(folder, 9))] == [
        "000003.enhanced.webp",
        "000009.enhanced.png",
    ]
    assert (await store.http.get(f"{run}/uploaded-samples")).json()["complete"] is True
    for answer in (
        await store.http.put(f"{run}/samples", json=index(3)),
        await store.http.put(f"{run}/samples/000003.jpg", content=JPEG),
    ):
        assert (answer.status_code, answer.json()["type"]) == (409, "tigas:samples-complete")


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("000003.jpg", b""),
        ("000003.jpg", JPEG[:-1]),
        ("000003.jpg", PNG),
        ("000003.enhanced.png", PNG[:-12]),
        ("000003.enhanced.webp", WEBP[:-4]),
        ("000003.enhanced.webp", b"RIFF"),
    ],
)
async def test_what_is_no_whole_picture_is_refused(store: Running, name: str, content: bytes) -> None:
    run = await begun(store)
    assert await put(store, run, name, content) == (
        400,
        f"{name} is not such an image, or is incomplete.",
    )
    assert not any("samples" in path for path in store.kept())


@pytest.mark.parametrize(
    "name", ["3.jpg", "000003.truth.png", "000003.jpg.exe", "..%2Frun.json", "000003.enhanced.jpg"]
)
async def test_other_names_are_refused(store: Running, name: str) -> None:
    run = await begun(store)
    kept = store.kept()
    answer = await store.http.put(f"{run}/samples/{name}", content=JPEG)
    assert answer.status_code in (400, 404, 405)
    assert store.kept() == kept


async def test_a_picture_and_a_run_have_limits(store: Running, monkeypatch: pytest.MonkeyPatch) -> None:
    run = await begun(store)
    with monkeypatch.context() as small:
        small.setattr(app, "MAX_PICTURE_BYTES", len(JPEG) - 1)
        assert await put(store, run, "000003.jpg", JPEG) == (413, f"The body is larger than {len(JPEG) - 1} bytes.")
    monkeypatch.setattr(samples, "MOST_FILES", 1)
    assert await put(store, run, "000003.jpg", JPEG) == (204, "")
    assert await put(store, run, "000003.jpg", JPEG) == (204, ""), "the same again is no other"
    assert (await put(store, run, "000004.jpg", JPEG))[0] == 413
    monkeypatch.setattr(samples, "MOST_FILES", 9)
    monkeypatch.setattr(samples, "MAX_RUN_BYTES", 10)
    assert await put(store, run, "000004.jpg", JPEG) == (413, "The samples of a run have at most 10 bytes.")


@pytest.mark.parametrize(
    ("body", "sentence"),
    [
        ({"samples": []}, "samples: tuple should have at least 1 item"),
        (index(3, 3), "Two samples have the same sequence number."),
        (index(4), "000004.jpg of"),
        ({"samples": [index(3)["samples"][0] | {"bytes": 1}]}, "000003.jpg of 1 bytes is missing."),
        ({"samples": [{"seq": 3}]}, "samples.0.at"),
    ],
)
async def test_an_index_that_is_not_true_is_refused(store: Running, body: dict[str, Any], sentence: str) -> None:
    run = await begun(store)
    assert await put(store, run, "000003.jpg", JPEG) == (204, "")
    answer = await store.http.put(f"{run}/samples", json=body)
    assert answer.status_code == 400
    assert sentence in answer.json()["detail"]
    assert not (await store.http.get(f"{run}/uploaded-samples")).json()["complete"]


async def test_links_are_not_followed(store: Running, tmp_path: Path) -> None:
    run = await begun(store)
    folder = store.results.joinpath(*run.split("/")[2:])
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (folder / "samples").symlink_to(elsewhere)
    assert (await put(store, run, "000003.jpg", JPEG))[0] == 500
    assert list(elsewhere.iterdir()) == []
    (folder / "samples").unlink()
    (folder / "samples").mkdir()
    (elsewhere / "secret").write_bytes(b"secret")
    (folder / "samples" / "000003.jpg").symlink_to(elsewhere / "secret")
    assert await put(store, run, "000003.jpg", JPEG) == (204, "")
    assert (elsewhere / "secret").read_bytes() == b"secret"
    assert read_sample_file(folder / "samples" / "000003.jpg") == JPEG


async def test_only_runs_of_the_page_get_samples(store: Running) -> None:
    by_command(store.results / "by-command", 1)
    for run, kind in (
        ("/experiments/by-command/runs/00", "experiment-in-use"),
        ("/experiments/nowhere/runs/00", "unknown-experiment"),
        (f"/experiments/{await store.create()}/runs/00", "unknown-run"),
    ):
        answers = [
            await store.http.put(f"{run}/samples/000003.jpg", content=JPEG),
            await store.http.put(f"{run}/samples", json=index(3)),
            await store.http.get(f"{run}/uploaded-samples"),
        ]
        assert {answer.json()["type"] for answer in answers} == {f"tigas:{kind}"}


async def test_a_run_that_was_never_ended_gets_a_place_for_its_samples(store: Running) -> None:
    experiment = await store.create()
    run = f"/experiments/{experiment}/runs/{slug()}"
    problem = "The page was closed before the run's end; only its samples are left."
    answer = await store.http.put(run, json={"problem": problem})
    assert answer.status_code == 200
    row = answer.json()
    assert (row["status"], row["problem"]) == ("failed", problem)
    assert await put(store, run, "000003.jpg", JPEG) == (204, "")
    assert (await store.http.put(f"{run}/samples", json=index(3))).status_code == 204
    assert (await store.next(experiment, begin=True))["missing"] == 2, "it is made again"
    listed = (await store.http.get(f"/experiments/{experiment}")).json()
    assert [one["folder"] for one in listed["runs"]] == [slug()]
