"""The process that the user starts: it has the public sockets and the secrets, and keeps engines and edges running."""

from __future__ import annotations

import asyncio
import os
import time
from collections.abc import Sequence
from pathlib import Path

from tigas_common.certificate import Certificate
from tigas_common.memory import keep_together
from tigas_common.runner import until_stopped
from tigas_render.cache import kept_key
from tigas_render.certificates import CertificateKeeper
from tigas_render.fleet.child import Child
from tigas_render.fleet.control import (
    EdgeStart,
    EngineStart,
    Message,
    NewCertificate,
    Ready,
    Said,
    TicketIssued,
    TicketTaken,
)
from tigas_render.fleet.devices import names
from tigas_render.fleet.directory import private_directory
from tigas_render.fleet.launched import Launched
from tigas_render.fleet.sockets import PublicSockets
from tigas_render.fleet.spare import Spare
from tigas_render.settings import RenderSettings
from tigas_render.transport.retry import KEY_LENGTH
from tigas_render.transport.tickets import TicketStore

EDGES_STOP_S = 1.2
"""For the edges to answer what is running, in seconds; the engines answer meanwhile."""
STOP_S = 1.7
"""For all, with the engines."""


async def supervise(settings: RenderSettings, devices: tuple[str, ...], edges: int) -> None:
    """Run the render service as so many edges, and an engine for each device, until SIGINT or SIGTERM.

    Raises StartError.
    """
    keep_together()
    with PublicSockets.bound(settings, edges) as sockets, private_directory() as directory:
        async with CertificateKeeper.running(settings) as keeper:
            await Supervisor(settings, devices, edges, sockets, directory, keeper).run()


class Supervisor:
    """Engines and edges, for as long as `run` lasts."""

    def __init__(
        self,
        settings: RenderSettings,
        devices: tuple[str, ...],
        edges: int,
        sockets: PublicSockets,
        directory: Path,
        keeper: CertificateKeeper,
    ) -> None:
        """directory: where the engines' own sockets are, for nobody else."""
        self._settings = settings
        self._devices = devices
        self._names = names(devices)
        self._sockets = sockets
        self._directory = directory
        self._reset_key = kept_key(settings.cache / "stateless-reset.key")
        self._retry_key = os.urandom(KEY_LENGTH)
        self._tickets = TicketStore()
        self._announcement: tuple[str, ...] = ()
        """What an engine says, to be printed once all serve."""
        self._said: set[str] = set()
        """Lines that were printed: no engine says again what another has said, or itself before it was restarted."""
        self._engines = [self._engine(number, edges) for number in range(len(devices))]
        for engine in self._engines:
            engine.others = [other for other in self._engines if other is not engine]
        self._spare = Spare(sockets.fds())
        self._edges = [self._edge(number, edges) for number in range(edges)]
        self._show(keeper.certificate)
        keeper.on_renewal(self._show)

    async def run(self) -> None:
        """Keep all running until SIGINT or SIGTERM. Raises StartError."""
        children = (*self._engines, *self._edges)
        stopped = asyncio.create_task(until_stopped())
        ready = asyncio.create_task(self._announce())
        kept = [asyncio.create_task(child.keep()) for child in children]
        try:
            await asyncio.wait((stopped, *kept), return_when=asyncio.FIRST_COMPLETED)
        finally:
            stopped.cancel()
            ready.cancel()
            await asyncio.gather(ready, return_exceptions=True)
            await self._end()
        for task in kept:
            task.result()

    async def _end(self) -> None:
        """Edges first, so that what is running is still answered."""
        began = time.monotonic()
        await self._spare.end()
        await asyncio.gather(*(edge.end(EDGES_STOP_S) for edge in self._edges))
        patience_s = began + STOP_S - time.monotonic()
        await asyncio.gather(*(engine.end(patience_s) for engine in self._engines))

    async def _announce(self) -> None:
        """Tell the user once all serve, or all but engines that cannot; what starts after that need not hurry."""
        for edge in self._edges:
            await edge.ready.wait()
        for engine in self._engines:
            await engine.settled.wait()
        if not self._announcement:  # there is nothing to serve with
            return
        missing = [engine.name for engine in self._engines if not engine.ready.is_set()]
        if missing:
            print(f"Started without the {', the '.join(missing)}.", flush=True)
        print("\n".join(self._announcement), flush=True)
        await self._spare.keep()

    # -- what children are told --------------------------------------------------------------------------------------

    def _show(self, certificate: Certificate) -> None:
        """Edges first: nobody hears of a certificate that is not shown yet."""
        self._certificate = NewCertificate(pem=certificate.with_key)
        for child in (*self._edges, *self._engines):
            child.tell(self._certificate)

    def _engine(self, number: int, edges: int) -> Child:
        is_alone = len(self._devices) == 1
        sockets = self._sockets

        def begin() -> Sequence[Message]:
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

        async def launch() -> Launched:
            return await Launched.start("tigas_render.fleet.engine", ())

        return Child("engine" if is_alone else f"engine on {self._names[number]}", launch, begin, self._heard)

    def _edge(self, number: int, edges: int) -> Child:
        name = f"edge {number}"
        public = self._sockets

        def begin() -> Sequence[Message]:
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
                relay=public.relays[number][0].fileno() if public.relays else None,
                relays=tuple(outbox.fileno() for _, outbox in public.relays),
                others=public.fds_of_others(number),
                certificate=self._certificate,
                reset_key=self._reset_key,
                retry_key=self._retry_key,
            )
            return (start, *(TicketIssued(ticket=ticket) for ticket in self._tickets))

        return Child(name, self._spare.take, begin, self._heard)

    # -- what children say -------------------------------------------------------------------------------------------

    def _heard(self, child: Child, message: Message) -> None:
        match message:
            case TicketIssued():
                self._tickets.add(message.ticket)
            case TicketTaken():
                self._tickets.take(message.label)
            case Ready():
                self._announcement = message.lines or self._announcement
                return
            case Said():
                if message.line not in self._said:
                    self._said.add(message.line)
                    print(message.line, flush=True)
                return
            case _:
                raise AssertionError(f"A child does not say {message.kind}.")
        for edge in self._edges:
            if edge is not child:
                edge.tell(message)
