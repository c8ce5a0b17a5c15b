"""This process's connection to a Ray cluster: the one in RAY_ADDRESS, or a private one on this machine.

Nothing here imports ray before its environment is set.
"""

from __future__ import annotations

import fcntl
import importlib.util
import json
import os
import secrets
import shutil
import signal
import socket
import stat
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from tigas_common.address import Address, parse_host
from tigas_common.errors import StartError
from tigas_common.installation import install_command

ADDRESS = "RAY_ADDRESS"
AUTO = "auto"
"""Value of RAY_ADDRESS for the cluster running on this machine."""
CONNECT_TIMEOUT_S = 5.0
"""Timeout for reaching the head, in seconds."""
NAMESPACE = "tigas"
"""Ray namespace of our actors."""
RESOURCE = "tigas_host"
"""Custom resource of a private Ray's node, which may have no GPU."""
OBJECT_STORE = 80 * 1024 * 1024
"""Size in bytes, hardly more than Ray's minimum, as nothing large goes through Ray."""
START_S = 30.0
STOP_S = 2.0
"""Seconds until Ray is killed."""
_SETTINGS = {
    "RAY_USAGE_STATS_ENABLED": "0",
    "RAY_GRACEFUL_SHUTDOWN_DRAIN_TIMEOUT_S": "0",  # only our hosts run there, and they have ended
    "RAY_memory_monitor_refresh_ms": "0",  # it would kill hosts, which have their own memory limit
}


class AlreadyManaged(StartError):
    """Another process is managing the cluster."""

    def __init__(self) -> None:
        super().__init__("Another `tigas cluster up` manages this cluster; stop it first.")


class PrivateRay:
    """A private Ray, one per user, with a token that only the user can read. It outlives its starter."""

    def __init__(self, folder: Path | None = None) -> None:
        """folder: for its files; short, as paths of Unix sockets in it are limited."""
        self._folder = folder or Path(tempfile.gettempdir()) / f"tigas-ray-{os.getuid()}"
        self._process = self._folder / "process"
        self._token = self._folder / "token"
        self._address = self._folder / "ray_current_cluster"  # Ray's own name for it

    @property
    def environment(self) -> dict[str, str]:
        """Environment variables that processes need before they import ray."""
        return {"RAY_AUTH_MODE": "token", "RAY_AUTH_TOKEN_PATH": str(self._token)}

    def find_address(self) -> str | None:
        """The address of Ray, if it is running."""
        return self._address.read_text().strip() if self._pid() is not None and self._address.exists() else None

    def start(self) -> str:
        """Start Ray unless it runs, and return its address. Raises StartError and AlreadyManaged."""
        if self._pid() is None:
            self._launch()
        deadline = time.monotonic() + START_S
        while (address := self.find_address()) is None:
            if self._pid() is None or time.monotonic() > deadline:
                raise StartError(f"Ray did not start: {self._last_log_line()}")
            time.sleep(0.05)
        return address

    def _last_log_line(self) -> str:
        log = self._folder / "log"
        lines = log.read_text(errors="replace").splitlines() if log.exists() else []
        said = next((line.strip() for line in reversed(lines) if line.strip()), "")
        return said[:500] or f"it was not ready within {START_S:.0f} s."

    def stop(self) -> None:
        """End Ray and remove its files."""
        if (pid := self._pid()) is not None:
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGTERM)
            deadline = time.monotonic() + STOP_S
            while self._pid() is not None and time.monotonic() < deadline:
                time.sleep(0.05)
            if self._pid() is not None:
                os.killpg(pid, signal.SIGKILL)
        shutil.rmtree(self._folder, ignore_errors=True)

    def _launch(self) -> None:
        self._make_folder()
        with self._process.open("a") as process:
            try:
                fcntl.flock(process, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                raise AlreadyManaged from None
            process.truncate(0)
            self._reset_folder()
            with (self._folder / "log").open("wb") as log:
                started = subprocess.Popen(
                    self._command(),
                    stdin=subprocess.DEVNULL,
                    stdout=log,
                    stderr=log,
                    start_new_session=True,
                    pass_fds=[process.fileno()],  # it keeps the file locked
                    env=os.environ | self.environment | _SETTINGS,
                )
            process.write(str(started.pid))

    def _make_folder(self) -> None:
        try:
            self._folder.mkdir(mode=0o700, exist_ok=True)
            status = self._folder.lstat()
        except OSError as error:
            raise StartError(f"Ray's folder {self._folder} cannot be created ({error.strerror}).") from None
        if not stat.S_ISDIR(status.st_mode) or status.st_uid != os.getuid():
            raise StartError(f"Ray's folder {self._folder} belongs to somebody else.")

    def _reset_folder(self) -> None:
        """Replace the files of a killed Ray, except the file that its process has locked."""
        try:
            for path in self._folder.iterdir():
                if path.is_dir() and not path.is_symlink():
                    shutil.rmtree(path)
                elif path != self._process:
                    path.unlink()
            self._token.write_text(secrets.token_hex(32))
        except OSError as error:
            raise StartError(f"Ray's folder {self._folder} cannot be replaced ({error.strerror}).") from None

    def _pid(self) -> int | None:
        """Process id of Ray, if it is alive."""
        with suppress(OSError, ValueError), self._process.open() as process:
            if self._folder.stat().st_uid != os.getuid():
                return None
            try:
                fcntl.flock(process, fcntl.LOCK_SH | fcntl.LOCK_NB)
            except BlockingIOError:
                return int(process.read())
        return None

    def _command(self) -> list[str]:
        return [
            *(sys.executable, "-m", "ray.scripts.scripts", "start", "--head", "--block"),
            "--node-ip-address=127.0.0.1",
            "--port=0",
            f"--temp-dir={self._folder}",
            f"--resources={json.dumps({RESOURCE: 1})}",
            f"--object-store-memory={OBJECT_STORE}",
            "--include-dashboard=false",
            "--include-log-monitor=false",
            "--no-monitor",
            "--disable-usage-stats",
        ]


def check_ray() -> None:
    if importlib.util.find_spec("ray") is None:
        raise StartError(f"A cluster needs Ray, which is not installed: {install_command('cluster')}")


def configured_address() -> str | None:
    """Address of the cluster to join, if one is configured. Raises StartError."""
    address = os.environ.get(ADDRESS)
    if not address or address == AUTO:
        return address or None
    try:
        head = Address.parse(address)
    except ValueError:
        head = None
    if head is None or parse_host(address) is None:
        raise StartError(f"{ADDRESS} must be the head's HOST:PORT, such as 10.0.0.1:6379, not {address[:100]!r}.")
    try:
        socket.create_connection((head.host, head.port), CONNECT_TIMEOUT_S).close()  # Ray would try for minutes
    except (OSError, UnicodeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise StartError(f"The Ray cluster at {head} cannot be reached ({reason}).") from None
    return address


@contextmanager
def connect(own: PrivateRay | None, address: str) -> Iterator[None]:
    """Connect to this cluster, possibly a private one, as a context manager. Raises StartError."""
    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
    if own is not None:
        os.environ.update(own.environment)
    import ray

    try:
        ray.init(
            address=address,
            namespace=NAMESPACE,
            log_to_driver=False,
            configure_logging=False,
            include_dashboard=False,
        )
    except (ConnectionError, RuntimeError, TimeoutError, ValueError) as error:
        reason = " ".join(str(error).split())
        raise StartError(f"The Ray cluster at {address} cannot be joined: {reason}") from None
    ray._private.worker._worker_logs_enabled = False  # hosts' states are reported in fewer words
    try:
        yield
    finally:
        ray.shutdown()
