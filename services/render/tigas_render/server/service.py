"""The running render service: its rasteriser, scenes, engine, previews, downloads and training."""

from __future__ import annotations

import asyncio
import logging
import time
from collections import Counter
from collections.abc import AsyncIterator, Iterator
from contextlib import AbstractAsyncContextManager, asynccontextmanager, contextmanager
from importlib.metadata import version
from urllib.parse import urlsplit

from prometheus_client.core import GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from tigas_common.address import bracket_host, is_loopback
from tigas_common.errors import BrokenScene, DeviceLost, Overloaded
from tigas_common.http_server import tcp_congestion_control
from tigas_common.installation import this_commit
from tigas_common.metrics import labelled_gauge
from tigas_common.origins import OriginPolicy
from tigas_common.topology import SERVICES_PATH, reachable_services
from tigas_common.wire.render import (
    DEFAULT_LADDER,
    HostLoad,
    RenderRequest,
    SceneInfo,
    ServerConfig,
    StillFormat,
    Training,
)
from tigas_render.admission.edge_loads import EdgeLoads
from tigas_render.admission.load import LoadState
from tigas_render.admission.viewers import ViewerAdmission
from tigas_render.downloads.cache import DownloadCache, FileSender
from tigas_render.engine.engine import Engine
from tigas_render.engine.metrics import EngineMetrics
from tigas_render.enhance.trainer import Trainer, TrainingUnavailable, training_problem
from tigas_render.enhance.weights_store import WeightsStore
from tigas_render.frame import Cancel, Client, Frame, FrameSource, OnAnswer
from tigas_render.raster.base import Rasterizer
from tigas_render.scenes.coarse import CoarseSceneCache
from tigas_render.scenes.registry import SceneRegistry
from tigas_render.scenes.source import SceneSource
from tigas_render.scenes.start_view.view import StartViewCache
from tigas_render.server.library import SceneLibrary
from tigas_render.server.preview import HEIGHT, WIDTH, Preview, PreviewCache, preview_camera
from tigas_render.settings import RenderSettings
from tigas_render.transport.certificate import Certificate
from tigas_render.uploads.parts import EDITING_FORBIDDEN, ScenesReadOnly

logger = logging.getLogger(__name__)

HOUSEKEEPING_S = 15
"""Seconds between checks for idle scenes, unfinished uploads and a stuck renderer."""

PREVIEW_CLIENT = "previews"
"""The client address of all thumbnails. Each scene is a session, because a session may queue only a few requests."""


class StateMetrics(Collector):
    """Prometheus metrics of an engine's unanswered requests and of its scenes."""

    def __init__(self, engine: Engine, scenes: SceneRegistry) -> None:
        self._engine = engine
        self._scenes = scenes

    def collect(self) -> Iterator[Metric]:
        states: Counter[str] = Counter(info.state for info in self._scenes.scene_infos())
        in_flight, memory = self._engine.in_flight, self._scenes.memory()
        yield labelled_gauge("tigas_render_requests_in_flight", "Unanswered requests, by stage", "stage", in_flight)
        yield labelled_gauge("tigas_render_scenes", "Scenes, by state", "state", states)
        yield labelled_gauge("tigas_render_scene_memory_bytes", "Memory of a scene", "scene", memory)
        yield GaugeMetricFamily(
            "tigas_render_scene_memory_limit_bytes", "Memory limit of all scenes together", self._scenes.budget
        )


class RenderService(FrameSource):
    """The running service. Transports request frames from it; `app` exposes the rest over HTTP."""

    def __init__(self, settings: RenderSettings, rasterizer: Rasterizer) -> None:
        self.settings = settings
        self.device = rasterizer.device
        self._hardware = rasterizer.hardware
        self._formats: tuple[StillFormat, ...] = ("jpeg", "webp") if rasterizer.makes_webp else ("jpeg",)
        self._commit = this_commit()
        metrics = EngineMetrics()
        self.registry = SceneRegistry(
            settings.scenes,
            rasterizer.pack,
            own_ladders=settings.ladder == "scene",
            views=StartViewCache(settings.cache),
            coarse=CoarseSceneCache(settings.cache),
            memory_budget=int(settings.memory_gb * 1e9),
            idle_s=60 * settings.idle_minutes,
            clock=time.monotonic,
        )
        self.engine = Engine(rasterizer, self.registry, DEFAULT_LADDER, metrics, time.monotonic)
        self.certificate: Certificate | None = None
        """The certificate presented over QUIC, once QUIC is served."""
        self.origins = OriginPolicy.from_addresses(settings.addresses, settings.allow_hosts, settings.allow_origins)
        self.loads = EdgeLoads(time.monotonic)
        self.metrics = (metrics, StateMetrics(self.engine, self.registry), self.loads)
        self.admission = ViewerAdmission(settings.quic_limits)
        """Admission of the viewers that this process serves itself."""
        self.quic_port: int | None = None
        """The port of QUIC, once it is served."""
        self.https_port: int | None = None
        self.url: str | None = None
        """The API's URL on this machine over HTTP/1.1, once it is served."""
        self.weights = WeightsStore(DEFAULT_LADDER, settings.cache)
        self.trainer = Trainer(rasterizer.device)
        self._training_problem = training_problem() if settings.pages_edit_scenes else EDITING_FORBIDDEN
        self.downloads = DownloadCache(settings.cache / "downloads", int(settings.downloads_gb * 1e9))
        self.file_sender = FileSender()
        self.rescan = self.registry.scan
        self.library = SceneLibrary(settings, self.registry, self.weights)
        self._previews = PreviewCache(settings.cache, self._render_preview)

    @classmethod
    @asynccontextmanager
    async def open(cls, settings: RenderSettings, rasterizer: Rasterizer) -> AsyncIterator[RenderService]:
        """A running service, as a context manager."""
        service = cls(settings, rasterizer)
        async with service.engine:
            await service.registry.scan()
            housekeeping = asyncio.create_task(service._run_housekeeping())
            try:
                yield service
            finally:
                housekeeping.cancel()
                await service.trainer.close()
        service.abort_work()

    def abort_work(self) -> None:
        """Abort the loading of scenes and the preparation of downloads, because the service is stopping."""
        self.registry.close()
        self.downloads.close()

    def set_certificate(self, certificate: Certificate) -> None:
        """Announce a certificate to pages from now on."""
        self.certificate = certificate

    def monitor_load(self) -> AbstractAsyncContextManager[None]:
        """Measure the load of this process, as the only edge, as a context manager."""
        return self.admission.monitor(self._record_load)

    def _record_load(self, state: LoadState) -> None:
        self.loads.update(0, state)
        self.admission.load.record_engine(*self.engine.state())

    def config(self, page: str) -> ServerConfig:
        """The configuration of a page that was opened at this origin."""
        host = urlsplit(page).hostname or "localhost"
        # QUIC does not fall back from ::1 to 127.0.0.1, so a browser must not choose between them.
        quic_host = "127.0.0.1" if host == "localhost" else host
        quic_port = self.quic_port if self._can_reach_quic(host) else None
        certificate = self.certificate if quic_port else None
        http3 = f"https://{bracket_host(quic_host)}:{quic_port}" if quic_port else None
        return ServerConfig(
            version=version("tigas"),
            commit=self._commit,
            device=self._hardware,
            formats=self._formats,
            ladder=DEFAULT_LADDER,
            certificate_sha256=certificate.sha256 if certificate else None,
            public_key_sha256=certificate.public_key_sha256 if certificate else None,
            webtransport_url=http3 and f"{http3}/render",
            https_url=f"https://{bracket_host(host)}:{self.https_port}/" if self.https_port else None,
            services=reachable_services(page, self.settings.services, self.settings.upstreams),
            dash_h3_url=f"{http3}{SERVICES_PATH}/dash" if http3 and "dash" in self.settings.upstreams else None,
            congestion_control=self.settings.congestion_control if quic_port else None,
            tcp_congestion_control=tcp_congestion_control(),
            retry_after_s=self.loads.retry_after_s(),
            max_upload_bytes=self.library.max_upload_bytes,
            why_no_training=self._training_problem,
        )

    def host_load(self, page: str) -> HostLoad:
        """The load of this host, for a director that assigns viewers to hosts. page: the origin of its URLs."""
        return HostLoad(
            config=self.config(page),
            viewers=self.loads.viewers,
            utilisation=self.loads.utilisation,
            queue_age_s=self.loads.queue_age_s,
            scenes=tuple(scene.id for scene in self.registry.scene_infos() if scene.state == "loaded"),
        )

    def _can_reach_quic(self, host: str) -> bool:
        """Whether a page that was opened at `host` can reach QUIC there; on loopback, only a local page can."""
        return self.settings.quic is not None and (not self.settings.quic.is_loopback or is_loopback(host))

    def request(self, client: Client, request: RenderRequest, arrived: float, on_answer: OnAnswer) -> Cancel:
        def record_answer(answer: Frame | Exception) -> None:
            if isinstance(answer, Frame):
                self.registry.mark_viewed(request.scene)
            on_answer(answer)

        return self.engine.request(client, request, arrived, record_answer)

    def forget(self, client: Client) -> None:
        self.engine.forget(client)

    async def load(self, scene_id: str, *, coarse: bool = False) -> None:
        """Load a scene and wait until it is loaded, like `SceneRegistry.load`; raises the same errors."""
        with self._report_device_loss():
            await self.registry.load(scene_id, coarse=coarse)

    async def scene_infos(self) -> list[SceneInfo]:
        """All scenes, with the networks and downloads available for each."""
        found = [(info, self.registry.source(info.id)) for info in self.registry.scene_infos()]
        return await asyncio.to_thread(lambda: [self._add_files(*each) for each in found])

    async def scene_info(self, scene_id: str) -> SceneInfo:
        """One scene. Raises UnknownScene."""
        info, source = self.registry.scene_info(scene_id), self.registry.source(scene_id)
        return await asyncio.to_thread(self._add_files, info, source)

    def _add_files(self, info: SceneInfo, source: SceneSource) -> SceneInfo:
        """A scene's description, including its additional files. Reads the disk, so call it in a worker thread."""
        files = {"enhance": self.weights.kind(source), "downloads": self.downloads.available(source)}
        return info.model_copy(update=files)

    async def training(self, scene_id: str) -> Training:
        """Progress of the training of a scene's networks. Raises UnknownScene."""
        source, state = self.registry.source(scene_id), self.trainer.state(scene_id)
        if state.state in ("running", "failed"):
            return state
        return state.model_copy(update={"problem": await asyncio.to_thread(self.weights.problem, source)})

    def train(self, scene_id: str) -> Training:
        """Start training a scene's networks. Raises UnknownScene, BrokenScene, ScenesReadOnly,
        TrainingUnavailable, TrainingRunning and ReadOnlyScene.
        """
        source = self.registry.source(scene_id)
        if source.error is not None:
            raise BrokenScene(source.error)
        self._require_training()
        if self.url is None:
            raise Overloaded("The service is starting; try again.")
        return self.trainer.start(scene_id, self.weights.writable_path(source), self.url)

    async def stop_training(self, scene_id: str) -> Training:
        """Stop a scene's training. Raises UnknownScene, ScenesReadOnly and TrainingUnavailable."""
        self.registry.source(scene_id)
        self._require_training()
        await self.trainer.stop(scene_id)
        return await self.training(scene_id)

    def _require_training(self) -> None:
        if not self.settings.pages_edit_scenes:
            raise ScenesReadOnly(EDITING_FORBIDDEN)
        if self._training_problem is not None:
            raise TrainingUnavailable(self._training_problem)

    async def preview(self, scene_id: str) -> Preview:
        """A scene's thumbnail. Raises UnknownScene and BrokenScene."""
        return await self._previews.get(self.registry.source(scene_id))

    async def _render_preview(self, scene_id: str) -> bytes:
        """Render a scene from its start camera, through the engine, so that it waits its turn like any other frame."""
        with self._report_device_loss():
            async with self.registry.use(scene_id) as scene:
                camera = preview_camera(scene.view.camera, scene.view.up, WIDTH, HEIGHT)
                request = RenderRequest.at(scene_id, camera.pose, camera.intrinsics)
                client = Client(PREVIEW_CLIENT, scene_id)
                return bytes((await self.engine.submit(client, request, time.monotonic())).body)

    @contextmanager
    def _report_device_loss(self) -> Iterator[None]:
        """Report a device lost in the meantime to the engine, since scenes are loaded outside it."""
        try:
            yield
        except DeviceLost as error:
            self.engine.lose_device(error)
            raise

    async def _run_housekeeping(self) -> None:
        while True:
            await asyncio.sleep(HOUSEKEEPING_S)
            self.engine.check_progress()
            try:
                self.engine.videos.forget_idle()
                self.registry.evict_idle(time.monotonic())
                await asyncio.to_thread(self.library.expire_uploads)
            except Exception:  # the next round tries again
                logger.exception("Housekeeping failed")
