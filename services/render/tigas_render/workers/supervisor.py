"""The process that the user starts, which owns the public sockets and the secrets, and keeps the workers running."""

from __future__ import annotations

import asyncio
import os
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from tigas_common.resources import use_one_arena
from tigas_common.runner import wait_for_stop
from tigas_render.local_files import load_or_create_key, locked_directory
from tigas_render.server.certificates import CertificateRenewer
from tigas_render.server.public_sockets import PublicSockets
from tigas_render.settings import RenderSettings
from tigas_render.transport.certificate import Certificate
from tigas_render.transport.shared_port import TicketStore, open_counts_file
from tigas_render.transport.stateless import RETRY_KEY_LENGTH
from tigas_render.workers.control import (
    EdgeStart,
    EngineStart,
    Message,
    NewCertificate,
    PrintLine,
    Ready,
    TicketIssued,
    TicketTaken,
)
from tigas_render.workers.devices import device_names
from tigas_render.workers.worker import Standby, Worker, WorkerProcess

DIRECTORY_PREFIX = "tigas-render-"
"""Prefix of the directory with the engines' sockets."""
EDGE_STOP_TIMEOUT_S = 1.2
"""Seconds for the edges to answer running requests, while the engines keep working."""
STOP_TIMEOUT_S = 1.7
"""Seconds for all workers to exit."""


async def supervise(settings: RenderSettings, devices: tuple[str, ...], edges: int) -> None:
    """Run the render service, with a number of edges and an engine for each device, until SIGINT or SIGTERM.

    Raises StartError.
    """
    use_one_arena()
    with (
        PublicSockets.open(settings, edges) as sockets,
        open_counts_file(edges) as counts,
        locked_directory(Path(tempfile.gettempdir()), DIRECTORY_PREFIX) as directory,
    ):
        async with CertificateRenewer.run(settings) as renewer:
            await Supervisor(settings, devices, edges, sockets, counts, directory, renewer).run()


class Supervisor:
    """Runs the engines and edges of a service."""

    def __init__(
        self,
        settings: RenderSettings,
        devices: tuple[str, ...],
        edges: int,
        sockets: PublicSockets,
        counts: int,
        directory: Path,
        renewer: CertificateRenewer,
    ) -> None:
        """counts: from `open_counts_file`. directory: for the engines' sockets, private to the user."""
        self._settings = settings
        self._devices = devices
        self._names = device_names(devices)
        self._sockets = sockets
        self._counts = counts
        self._directory = directory
        self._reset_key = load_or_create_key(settings.cache / "stateless-reset.key")
        self._retry_key = os.urandom(RETRY_KEY_LENGTH)
        self._tickets = TicketStore()
        self._announcement: tuple[str, ...] = ()
        """An engine's announcement, to be printed once all workers are serving."""
        self._printed: set[str] = set()
        """Lines that have been printed, so that other engines, or a restarted one, do not repeat them."""
        self._engines = [self._create_engine(number, edges) for number in range(len(devices))]
        for engine in self._engines:
            engine.others = [other for other in self._engines if other is not engine]
        self._standby = Standby((*sockets.file_descriptors(), counts))
        self._edges = [self._create_edge(number, edges) for number in range(edges)]
        self._distribute_certificate(renewer.certificate)
        renewer.add_listener(self._distribute_certificate)

    async def run(self) -> None:
        """Keep all workers running until SIGINT or SIGTERM. Raises StartError."""
        workers = (*self._engines, *self._edges)
        stopped = asyncio.create_task(wait_for_stop())
        ready = asyncio.create_task(self._announce())
        supervising = [asyncio.create_task(worker.run()) for worker in workers]
        try:
            await asyncio.wait((stopped, *supervising), return_when=asyncio.FIRST_COMPLETED)
        finally:
            stopped.cancel()
            ready.cancel()
            await asyncio.gather(ready, return_exceptions=True)
            await self._stop_workers()
        for task in supervising:
            task.result()

    async def _stop_workers(self) -> None:
        """Stop the workers, edges first, so that running requests are still answered."""
        began = time.monotonic()
        await self._standby.kill()
        await asyncio.gather(*(edge.stop(EDGE_STOP_TIMEOUT_S) for edge in self._edges))
        patience_s = began + STOP_TIMEOUT_S - time.monotonic()
        await asyncio.gather(*(engine.stop(patience_s) for engine in self._engines))

    async def _announce(self) -> None:
        """Print the announcement once all workers are serving, except engines that cannot, and then keep a standby."""
        for edge in self._edges:
            await edge.ready.wait()
        for engine in self._engines:
            await engine.settled.wait()
        if not self._announcement:  # no engine is serving
            return
        missing = [engine.name for engine in self._engines if not engine.ready.is_set()]
        if missing:
            print(f"Started without the {', the '.join(missing)}.", flush=True)
        print("\n".join(self._announcement), flush=True)
        await self._standby.maintain()

    def _distribute_certificate(self, certificate: Certificate) -> None:
        """Distribute a certificate, to edges first, because engines announce it to clients."""
        self._certificate = NewCertificate(pem=certificate.pem_with_key)
        for worker in (*self._edges, *self._engines):
            worker.send(self._certificate)

    def _create_engine(self, number: int, edges: int) -> Worker:
        is_alone = len(self._devices) == 1
        sockets = self._sockets

        def first_messages() -> Sequence[Message]:
            start = EngineStart(
                name="engine" if is_alone else f"engine {number}",
                settings=self._settings.model_copy(update={"device": self._devices[number]}),
                number=number,
                devices=self._names,
                edges=edges,
                directory=self._directory,
                http_port=sockets.http_port,
                https_port=sockets.https_port,
                quic_port=sockets.quic_port,
                certificate=self._certificate,
            )
            return (start,)

        async def launch() -> WorkerProcess:
            return await WorkerProcess.start("engine", ())

        name = "engine" if is_alone else f"engine on {self._names[number]}"
        return Worker(name, launch, first_messages, self._on_message)

    def _create_edge(self, number: int, edges: int) -> Worker:
        name = f"edge {number}"
        public = self._sockets

        def first_messages() -> Sequence[Message]:
            start = EdgeStart(
                name=name,
                settings=self._settings,
                devices=self._names,
                directory=self._directory,
                number=number,
                edges=edges,
                http=public.http.fileno(),
                https=None if public.https is None else public.https.fileno(),
                quic=tuple(sock.fileno() for sock in public.quic[number]) if public.quic else (),
                counts=self._counts,
                certificate=self._certificate,
                reset_key=self._reset_key,
                retry_key=self._retry_key,
            )
            return (start, *(TicketIssued(ticket=ticket) for ticket in self._tickets))

        return Worker(name, self._standby.acquire, first_messages, self._on_message)

    def _on_message(self, sender: Worker, message: Message) -> None:
        match message:
            case TicketIssued():
                self._tickets.add(message.ticket)
            case TicketTaken():
                self._tickets.pop(message.label)
            case Ready():
                self._announcement = message.lines or self._announcement
                return
            case PrintLine():
                if message.line not in self._printed:
                    self._printed.add(message.line)
                    print(message.line, flush=True)
                return
            case _:
                raise AssertionError(f"A worker does not send {message.kind} messages.")
        for edge in self._edges:
            if edge is not sender:
                edge.send(message)
