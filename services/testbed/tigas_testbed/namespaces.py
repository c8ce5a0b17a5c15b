"""Three network namespaces, joined like this; the gateway forwards and shapes, everything else only uses it.

    host ─────── client ─────────── gateway ─────────── service
     host 198.18.0.1  host 198.18.0.2
                     access 198.18.1.2  access 198.18.1.1
                                        service 198.18.2.1  service 198.18.2.2

198.18.0.0/15 is reserved for such benches (RFC 2544), so it collides with no real network. Both ends of a veth pair
are named after the namespace they lead to. The host has its own pair only if the lab must be reachable from it.

In the client, and on the host, the lab's ports on 127.0.0.1 lead to the gateway (nftables DNAT): a browser opens
`http://localhost:8080`, which is a secure context, and its traffic crosses the shaped link.
"""

from __future__ import annotations

import os
import re
import shutil
import signal
import socket
import struct
import subprocess
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from typing import Literal

from tigas_common.errors import StartError
from tigas_common.resources import CAP_NET_ADMIN, CAP_SYS_ADMIN, has_capabilities
from tigas_common.topology import Port

PREFIX = "tigas-"
Role = Literal["client", "gateway", "service"]
ROLES: tuple[Role, ...] = ("client", "gateway", "service")
HOST_ADDRESS, CLIENT_HOST_ADDRESS = "198.18.0.1", "198.18.0.2"
CLIENT_ADDRESS, GATEWAY_ADDRESS = "198.18.1.2", "198.18.1.1"
GATEWAY_SERVICE_ADDRESS, SERVICE_ADDRESS = "198.18.2.1", "198.18.2.2"
TOOLS = {
    "ip": "iproute2",
    "tc": "iproute2",
    "nft": "nftables",
    "ethtool": "ethtool",
    "sysctl": "procps",
    "setpriv": "util-linux",
    "mount": "mount",
}
"""Commands used by the lab and its shaper, and the Debian packages that contain them."""
STOP = b"stop"
STOP_S = 20
"""Longer than the services take to end."""
CREDENTIALS = struct.Struct("3i")
"""Process, user and group of a sender (unix(7))."""
_NAME = re.compile(r"[a-z0-9]{1,20}")


class Lab:
    def __init__(self, name: str) -> None:
        if not _NAME.fullmatch(name):
            raise ValueError(f"a lab's name is 1 to 20 lower-case letters and digits, not {name!r}")
        self.name = name

    def namespace(self, role: Role) -> str:
        """Name of the namespace for `ip netns`."""
        return f"{PREFIX}{self.name}-{role}"

    def command(self, role: Role, argv: Sequence[str]) -> list[str]:
        """Command line that runs another one in a namespace, as root, and ends it when its parent ends."""
        return ["ip", "netns", "exec", self.namespace(role), "setpriv", "--pdeathsig", "KILL", *argv]

    def exists(self) -> bool:
        return self.namespace("gateway") in _list_namespaces()

    def processes(self, role: Role) -> list[int]:
        return [int(pid) for pid in _output("ip", "netns", "pids", self.namespace(role)).split()]

    @contextmanager
    def up(self, ports: Sequence[Port] = (), *, host: bool = False) -> Iterator[Lab]:
        """Run the lab during the context, with `ports` of the client's 127.0.0.1 leading to the gateway. `host`
        connects this machine to the client's side, with the same ports.

        Removes a leftover lab of the same name first. Raises StartError.
        """
        with ExitStack() as stack:
            lock = stack.enter_context(_lock(self.name))
            listening = threading.Thread(target=_wait_for_stop, args=(lock,), daemon=True)
            listening.start()
            stack.callback(listening.join)
            stack.callback(lock.shutdown, socket.SHUT_RDWR)
            self.remove()
            stack.callback(self.remove)
            self._build(ports, host=host)
            yield self

    def stop(self) -> None:
        """End the process that runs the lab, if any, like Ctrl+C. Raises StartError if it does not end."""
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as messenger:
            try:
                messenger.sendto(STOP, _lock_address(self.name))
            except ConnectionRefusedError:
                return
            except BrokenPipeError:
                pass  # it is already ending
        latest = time.monotonic() + STOP_S
        while True:
            try:
                with _lock(self.name):
                    return
            except StartError:
                if time.monotonic() > latest:
                    raise StartError("The lab does not stop; end its `tigas lab up`.") from None
                time.sleep(0.1)

    def remove(self) -> None:
        """End all processes in the lab's namespaces, and remove the namespaces and the host's link."""
        existing = _list_namespaces()
        for role in ROLES:
            namespace = self.namespace(role)
            if namespace in existing:
                for pid in self.processes(role):
                    with suppress(ProcessLookupError):
                        os.kill(pid, signal.SIGKILL)
                subprocess.run(("ip", "netns", "del", namespace), check=True)
        subprocess.run(("nft", "delete", "table", "ip", self._table), stderr=subprocess.DEVNULL)

    @property
    def _table(self) -> str:
        return f"tigas_lab_{self.name}"

    def _build(self, ports: Sequence[Port], *, host: bool) -> None:
        client, gateway, service = map(self.namespace, ROLES)
        try:
            for namespace in (client, gateway, service):
                _run("ip", "netns", "add", namespace)
                _run("ip", "-n", namespace, "link", "set", "lo", "up")
                _set_tcp_congestion_control(namespace)
            _create_veth((client, "access", CLIENT_ADDRESS), (gateway, "access", GATEWAY_ADDRESS))
            _create_veth((gateway, "service", GATEWAY_SERVICE_ADDRESS), (service, "service", SERVICE_ADDRESS))
            # No segmentation offload: a super-packet would cross the link as one burst.
            for namespace, interface in ((client, "access"), (service, "service")):
                _run(*_exec_in(namespace), "ethtool", "-K", interface, "tso", "off", "gso", "off",
                     "tx-udp-segmentation", "off")  # fmt: skip
            _forward_localhost(_exec_in(client), "access", CLIENT_ADDRESS, self._table, ports)
            if host:
                inside = f"{PREFIX}{self.name}"[:15]
                _create_veth((client, "host", CLIENT_HOST_ADDRESS), (None, inside, HOST_ADDRESS))
                _run("ip", "route", "add", f"{GATEWAY_ADDRESS}/32", "via", CLIENT_HOST_ADDRESS)
                _run(*_exec_in(client), "sysctl", "-qw", "net.ipv4.ip_forward=1")
                _forward_localhost((), inside, HOST_ADDRESS, self._table, ports)
        except FileNotFoundError as error:
            raise StartError(f"The lab needs {error.filename}: install iproute2, nftables and ethtool.") from None
        except subprocess.CalledProcessError as error:
            reason = " ".join(error.stderr.split()) if error.stderr else "no reason given"
            raise StartError(f"The lab cannot be built: {' '.join(error.cmd)} failed ({reason}).") from None


def _set_tcp_congestion_control(namespace: str) -> None:
    """Use CUBIC in every lab if the kernel allows it, whatever the machine's default. Runs record the result."""
    with suppress(subprocess.CalledProcessError):
        _run(*_exec_in(namespace), "sysctl", "-qw", "net.ipv4.tcp_congestion_control=cubic")


def check_rights() -> None:
    """Raise StartError if this process cannot create network namespaces, or lacks a tool for it."""
    if os.geteuid() != 0 or not has_capabilities(CAP_NET_ADMIN, CAP_SYS_ADMIN):
        raise StartError("The lab creates network namespaces, which needs root: run it with sudo.")
    if missing := {package for tool, package in TOOLS.items() if shutil.which(tool) is None}:
        raise StartError(f"The lab needs more tools: sudo apt-get install {' '.join(sorted(missing))}")


def _lock_address(name: str) -> str:
    return f"\0tigas-lab-{name}"


@contextmanager
def _lock(name: str) -> Iterator[socket.socket]:
    """Exclusive right to run the lab: a socket that also receives the request to stop. Raises StartError."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as lock:
        lock.setsockopt(socket.SOL_SOCKET, socket.SO_PASSCRED, 1)
        try:
            lock.bind(_lock_address(name))
        except OSError:
            raise StartError("The lab is already up; stop it with `tigas lab down`.") from None
        yield lock


def _wait_for_stop(lock: socket.socket) -> None:
    """Wait for a message from this user, until the socket is shut down, and end this process as SIGTERM does."""
    while True:
        message, credentials, _, _ = lock.recvmsg(len(STOP), socket.CMSG_SPACE(CREDENTIALS.size))
        if not message:
            return
        if any(CREDENTIALS.unpack(data)[1] == os.geteuid() for _, _, data in credentials):
            os.kill(os.getpid(), signal.SIGTERM)


def _forward_localhost(inside: Sequence[str], interface: str, address: str, table: str, ports: Sequence[Port]) -> None:
    """Forward ports of 127.0.0.1 to the gateway, through an interface with this address."""
    if not ports:
        return
    _run(*inside, "sysctl", "-qw", f"net.ipv4.conf.{interface}.route_localnet=1")
    rules = [
        f"table ip {table} {{",
        "chain out { type nat hook output priority -100;",
        *(f"ip daddr 127.0.0.1 {port.protocol} dport {port.number} dnat to {GATEWAY_ADDRESS}" for port in ports),
        "}",
        "chain leave { type nat hook postrouting priority srcnat;",
        f'oifname "{interface}" ip saddr != {address} snat to {address}',
        "}",
        "}",
    ]
    _run(*inside, "nft", "-f", "-", text="\n".join(rules))


def _create_veth(*ends: tuple[str | None, str, str]) -> None:
    """Create a veth pair between two (namespace, interface, address) and bring it up; None is the host's namespace."""
    (first, name, _), (second, peer_name, _) = ends
    peer = ["peer", "name", peer_name]
    _run(*_ip(first), "link", "add", name, "type", "veth", *peer, "netns", second or str(os.getpid()))
    for namespace, interface, address in ends:
        _run(*_ip(namespace), "addr", "add", f"{address}/24", "dev", interface)
        _run(*_ip(namespace), "link", "set", interface, "up")


def _ip(namespace: str | None) -> tuple[str, ...]:
    return ("ip", "-n", namespace) if namespace else ("ip",)


def _exec_in(namespace: str) -> tuple[str, ...]:
    return ("ip", "netns", "exec", namespace)


def _list_namespaces() -> list[str]:
    return [line.split()[0] for line in _output("ip", "netns", "list").splitlines()]


def _run(*argv: str, text: str | None = None) -> None:
    subprocess.run(argv, check=True, capture_output=True, text=True, input=text)


def _output(*argv: str) -> str:
    return subprocess.run(argv, check=True, capture_output=True, text=True).stdout
