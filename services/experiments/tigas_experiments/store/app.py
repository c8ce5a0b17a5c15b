"""The store's HTTP interface: only Starlette routes."""

from __future__ import annotations

import asyncio
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

from starlette.applications import Starlette
from starlette.requests import ClientDisconnect, Request
from starlette.responses import Response, StreamingResponse
from starlette.routing import Route
from starlette.types import ASGIApp

from tigas_common.errors import BodyTooLarge, InvalidRequest
from tigas_common.metrics import RequestMetrics, metrics_route, new_registry
from tigas_common.openapi import index, openapi
from tigas_common.origins import OriginCheck, OriginPolicy
from tigas_common.parsing import parse
from tigas_common.web import (
    EXCEPTION_HANDLERS,
    NO_STORE,
    PICTURES,
    ModelResponse,
    created_response,
    described,
    healthz,
    json_response,
    read_body,
    read_message,
)
from tigas_experiments.records.samples import MAX_PICTURE_BYTES
from tigas_experiments.store.errors import storage_errors
from tigas_experiments.store.experiments import Experiments
from tigas_experiments.store.limited import MAX_REQUEST_BYTES
from tigas_experiments.store.metrics import StoreMetrics
from tigas_experiments.store.movements import Movements
from tigas_experiments.store.planner import Planner
from tigas_experiments.store.reports import Reports, archive
from tigas_experiments.store.rerendering import RerenderingJobs
from tigas_experiments.store.samples import (
    MAX_INDEX_BYTES,
    check_upload,
    keep_capture,
    keep_index,
    keep_picture,
    list_samples,
    list_uploaded,
    read_picture,
)
from tigas_experiments.store.workspace import Workspace
from tigas_experiments.wire.recording import MAX_BYTES
from tigas_experiments.wire.store import (
    Experiment,
    ExperimentCreated,
    ExperimentList,
    ExperimentRequest,
    Materialisation,
    MovementList,
    NextRequest,
    NextRun,
    PlanSummary,
    RunRow,
    RunUpload,
    SampleIndex,
    SampleList,
    UploadedSamples,
)

# A report is self-contained, and must not be able to act as a page of the store.
REPORT_HEADERS = NO_STORE | {
    "Content-Security-Policy": "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; "
    "img-src data:; font-src data:; sandbox allow-scripts allow-popups allow-downloads"
}

MAX_NAME = 100
_PICTURE = re.compile(r"\w[\w.-]*", re.ASCII)
"""Pattern of a picture's name."""

# Always served as an image, regardless of the content.
PICTURE_HEADERS = NO_STORE | {"X-Content-Type-Options": "nosniff", "Content-Security-Policy": "default-src 'none'"}


@dataclass(frozen=True)
class Store:
    """Components of the store, opened and closed by the caller."""

    workspace: Workspace
    experiments: Experiments
    reports: Reports
    movements: Movements
    planner: Planner
    rerendering: RerenderingJobs


def create_app(store: Store, policy: OriginPolicy) -> ASGIApp:
    queues = {"check": store.planner.checks, "report": store.reports.lock, "materialise": store.rerendering.lock}
    figures = StoreMetrics(store.experiments.results, queues)
    registry = new_registry("store", figures)
    app = Starlette(
        routes=[
            index("Experiment store"),
            openapi("Experiment store"),
            Route("/plans", summarise, methods=["POST"]),
            Route("/experiments", create, methods=["POST"]),
            Route("/experiments", experiments),
            Route("/experiments/{id}", remove, methods=["DELETE"]),
            Route("/experiments/{id}", experiment),
            Route("/experiments/{id}/next", next_run, methods=["POST"]),
            Route("/experiments/{id}/pages/{page}", release, methods=["DELETE"]),
            Route("/experiments/{id}/runs/{run}", add_run, methods=["PUT"]),
            Route("/experiments/{id}/runs/{run}/captures/{name}", add_capture, methods=["PUT"]),
            Route("/experiments/{id}/runs/{run}/complete", complete_run, methods=["POST"]),
            Route("/experiments/{id}/runs/{run}/samples", samples),
            Route("/experiments/{id}/runs/{run}/samples/{name}", sample),
            Route("/experiments/{id}/materialise", start_rerendering, methods=["POST"]),
            Route("/experiments/{id}/materialise", rerendering),
            Route("/experiments/{id}/materialise", stop_rerendering, methods=["DELETE"]),
            Route("/experiments/{id}/runs/{run}/uploaded-samples", uploaded_samples),
            Route("/experiments/{id}/runs/{run}/samples/{name}", add_picture, methods=["PUT"]),
            Route("/experiments/{id}/runs/{run}/samples", complete_samples, methods=["PUT"]),
            Route("/experiments/{id}/zip", download),
            Route("/experiments/{id}/report", report),
            Route("/movements", movements),
            Route("/movements/{name}", movement),
            Route("/healthz", healthz),
            metrics_route(registry),
        ],
        exception_handlers=EXCEPTION_HANDLERS,
    )
    app.state.store = store
    app.state.metrics = figures
    return RequestMetrics(OriginCheck(app, policy), app.routes, registry)


async def experiments(request: Request) -> ModelResponse[ExperimentList]:
    """All experiments."""
    return json_response(await asyncio.to_thread(_store(request).experiments.all))


@described(takes=ExperimentRequest)
async def summarise(request: Request) -> ModelResponse[PlanSummary]:
    """Expand an experiment's file without storing anything."""
    return json_response(await _store(request).planner.summary(await read_body(request, MAX_REQUEST_BYTES)))


@described(takes=ExperimentRequest)
async def create(request: Request) -> ModelResponse[ExperimentCreated]:
    """Start an experiment."""
    made = await _store(request).planner.create(await read_body(request, MAX_REQUEST_BYTES))
    return created_response(ExperimentCreated(id=made), f"/experiments/{quote(made)}")


@described(takes=NextRequest)
async def next_run(request: Request) -> ModelResponse[NextRun]:
    """Reserve the next run for a page to perform."""
    asked = await read_message(request, NextRequest)
    return json_response(await _store(request).planner.next(request.path_params["id"], asked))


async def release(request: Request) -> Response:
    """Give up a page's reserved run."""
    await _store(request).planner.release(request.path_params["id"], request.path_params["page"])
    return Response(status_code=204)


async def experiment(request: Request) -> ModelResponse[Experiment]:
    """An experiment and its runs."""
    return json_response(await asyncio.to_thread(_store(request).experiments.get, request.path_params["id"]))


async def remove(request: Request) -> Response:
    """Remove an experiment and everything in its folder."""
    store, experiment = _store(request), request.path_params["id"]
    await asyncio.to_thread(store.experiments.remove, experiment)
    store.planner.forget(experiment)
    return Response(status_code=204)


@described(takes=RunUpload)
async def add_run(request: Request) -> ModelResponse[RunRow]:
    """Store a performed run, which is incomplete until its captures are uploaded."""
    store, experiment, run = _store(request), request.path_params["id"], request.path_params["run"]
    await asyncio.to_thread(store.experiments.find_page, experiment)  # before receiving hundreds of megabytes
    with store.planner.count_disk_failures(experiment, run), storage_errors(), store.workspace.folder() as folder:
        body = folder / "body.json"
        size = await _receive(request, body, MAX_BYTES)
        row = await store.planner.add(experiment, run, body, size, folder / "run")
        _metrics(request).runs += 1
    return json_response(row)


@described(takes=PICTURES)
async def add_capture(request: Request) -> Response:
    """Store a capture of an incomplete run."""
    await _keep_picture(request, keep_capture)
    return Response(status_code=204)


async def complete_run(request: Request) -> ModelResponse[RunRow]:
    """Compare a run's captures, all of which must be uploaded, with ground truth, and mark the run as complete."""
    return json_response(await _store(request).planner.complete(request.path_params["id"], request.path_params["run"]))


async def samples(request: Request) -> ModelResponse[SampleList]:
    """The samples of a run."""
    return json_response(await asyncio.to_thread(lambda: list_samples(_run(request))))


@described(gives=PICTURES)
async def sample(request: Request) -> Response:
    """A sample's picture."""
    data, media_type = await asyncio.to_thread(lambda: read_picture(_run(request), request.path_params["name"]))
    return Response(data, media_type=media_type, headers=PICTURE_HEADERS)


async def start_rerendering(request: Request) -> ModelResponse[Materialisation]:
    """Start or continue rendering an experiment's samples again."""
    answer = json_response(await _store(request).rerendering.start(request.path_params["id"]))
    answer.status_code = 202
    return answer


async def rerendering(request: Request) -> ModelResponse[Materialisation]:
    """Progress of rendering an experiment's samples again."""
    return json_response(await _store(request).rerendering.get(request.path_params["id"]))


async def stop_rerendering(request: Request) -> ModelResponse[Materialisation]:
    """Stop rendering samples; results so far are kept."""
    return json_response(await _store(request).rerendering.stop(request.path_params["id"]))


async def uploaded_samples(request: Request) -> ModelResponse[UploadedSamples]:
    """List a run's uploaded samples."""
    return json_response(await asyncio.to_thread(lambda: list_uploaded(_page_run(request))))


@described(takes=PICTURES)
async def add_picture(request: Request) -> Response:
    """Store a sample's picture."""
    await asyncio.to_thread(lambda: check_upload(_page_run(request), request.path_params["name"]))
    await _keep_picture(request, keep_picture)
    return Response(status_code=204)


@described(takes=SampleIndex)
async def complete_samples(request: Request) -> Response:
    """Store the index of a run's samples, after all of their pictures."""
    store, body = _store(request), await read_body(request, MAX_INDEX_BYTES)
    with storage_errors(), store.workspace.folder() as folder:
        index = await asyncio.to_thread(parse, SampleIndex, body, MAX_INDEX_BYTES)
        await asyncio.to_thread(lambda: keep_index(index, folder, _page_run(request)))
    return Response(status_code=204)


@described(gives=("application/zip",))
async def download(request: Request) -> Response:
    """An experiment's folder as a ZIP."""
    name = request.path_params["id"]
    folder, _ = await asyncio.to_thread(_store(request).experiments.find, name)
    headers = {"Content-Disposition": f"attachment; filename*=UTF-8''{quote(name)}.zip"}
    return StreamingResponse(_archived(folder), media_type="application/zip", headers=NO_STORE | headers)


@described(gives=("text/html",))
async def report(request: Request) -> Response:
    """An experiment's report, remade if runs were added or removed."""
    html = await _store(request).reports.html(request.path_params["id"])
    return Response(html, media_type="text/html", headers=REPORT_HEADERS)


async def movements(request: Request) -> ModelResponse[MovementList]:
    """All movement traces."""
    return json_response(await asyncio.to_thread(_store(request).movements.all))


@described(gives=("text/csv",))
async def movement(request: Request) -> Response:
    """The file of a movement trace."""
    text = await asyncio.to_thread(_store(request).movements.text, request.path_params["name"])
    return Response(text, media_type="text/csv", headers=NO_STORE)


async def _receive(request: Request, path: Path, limit: int) -> int:
    """Write the request's body into a file, and return its size.

    Raises BodyTooLarge, InvalidRequest if the body is incomplete, and OSError.
    """
    size, too_large = 0, BodyTooLarge(f"The body is larger than {limit} bytes.")
    if int(request.headers.get("content-length", 0)) > limit:
        raise too_large
    try:
        with path.open("wb") as file:
            async for part in request.stream():  # the server limits how long this waits
                size += len(part)
                _metrics(request).received_bytes += len(part)
                if size > limit:
                    raise too_large
                await asyncio.to_thread(file.write, part)
    except ClientDisconnect:
        raise InvalidRequest("The client disconnected before its request was complete.") from None
    return size


async def _keep_picture(request: Request, keep: Callable[[Path, Path], None]) -> None:
    """Receive a picture under its name, and have `keep` move it to its run."""
    run, name = await asyncio.to_thread(lambda: _page_run(request)), request.path_params["name"]
    if not _PICTURE.fullmatch(name) or len(name) > MAX_NAME:
        raise InvalidRequest(f"{name[:60]!r} is not the name of an image.")
    with storage_errors(), _store(request).workspace.folder() as folder:
        await _receive(request, folder / name, MAX_PICTURE_BYTES)
        await asyncio.to_thread(keep, folder / name, run)
    _store(request).planner.extend(request.path_params["id"], request.path_params["run"])


def _archived(folder: Path) -> Iterator[bytes]:
    """Stream a ZIP, and abort the response if it cannot be completed."""
    with storage_errors():
        yield from archive(folder)


def _run(request: Request) -> Path:
    return _store(request).experiments.run(request.path_params["id"], request.path_params["run"])


def _page_run(request: Request) -> Path:
    return _store(request).experiments.page_run(request.path_params["id"], request.path_params["run"])


def _metrics(request: Request) -> StoreMetrics:
    figures: StoreMetrics = request.app.state.metrics
    return figures


def _store(request: Request) -> Store:
    store: Store = request.app.state.store
    return store
