"""The state of a cluster's hosts, for `tigas cluster status`."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime
from typing import TYPE_CHECKING

import httpx
from pydantic import BaseModel

from tigas_cluster.connection import PrivateRay, configured_address, connect
from tigas_cluster.fleet import MAX_REPORT_BYTES
from tigas_cluster.host import Facts
from tigas_common.errors import StartError, TigasError
from tigas_common.parsing import parse
from tigas_common.wire.render import HostLoad

if TYPE_CHECKING:
    from rich.table import Table

ANSWER_S = 2.0


class HostStatus(BaseModel):
    """Status of one host; fields are None if it is not serving."""

    host: str
    address: str | None = None
    """Address of its machine."""
    url: str | None = None
    """URL of its API within the cluster."""
    since: datetime | None = None
    failure: str | None = None
    """Reported reason for not serving."""
    device: str | None = None
    viewers: int | None = None
    utilisation: float | None = None
    """Utilisation of the busiest stage, 0 to 1."""
    queue_age_s: float | None = None
    full: bool | None = None
    """Whether new viewers are refused."""
    scenes: tuple[str, ...] | None = None
    """Loaded scenes."""


def read_statuses() -> Sequence[HostStatus]:
    """Status of every host. Raises StartError."""
    address, own = configured_address(), None
    if address is None:
        own = PrivateRay()
        address = own.find_address()
        if address is None:
            raise StartError(
                "No cluster is running here: start one with `tigas cluster up`, or name another in RAY_ADDRESS."
            )
    with connect(own, address):
        from tigas_cluster.ray_cluster import RayCluster

        cluster = RayCluster("")
        hosts = cluster.hosts()
        facts = cluster.facts(hosts)
    with ThreadPoolExecutor(max_workers=16) as pool:
        names = sorted(hosts, key=lambda name: int(name.rpartition("-")[2]))
        return list(pool.map(lambda name: _status(name, facts.get(name)), names))


def make_table(hosts: Sequence[HostStatus]) -> Table:
    from rich.table import Table

    made = Table("host", "address", "device", "viewers", "busy", "queue, ms", "scenes", "since", box=None)
    for each in hosts:
        since = each.since.astimezone().strftime("%Y-%m-%d %H:%M") if each.since else ""
        if each.viewers is None or each.utilisation is None or each.queue_age_s is None:
            made.add_row(each.host, each.address, each.failure or "not serving", "", "", "", "", since)
            continue
        made.add_row(
            each.host,
            each.address,
            each.device,
            f"{each.viewers} (full)" if each.full else str(each.viewers),
            f"{each.utilisation:.0%}",
            f"{1000 * each.queue_age_s:.0f}",
            ", ".join(each.scenes or ()),
            since,
        )
    return made


def _status(name: str, facts: Facts | None) -> HostStatus:
    if facts is None:
        return HostStatus(host=name)
    found = HostStatus(
        host=name,
        address=facts["address"],
        url=facts["url"],
        since=datetime.fromtimestamp(facts["since"], UTC),
        failure=facts["failure"],
    )
    if (load := _load(found.url)) is not None:
        found.device = load.config.device
        found.viewers, found.utilisation, found.queue_age_s = load.viewers, load.utilisation, load.queue_age_s
        found.full, found.scenes = load.config.retry_after_s is not None, load.scenes
    return found


def _load(url: str | None) -> HostLoad | None:
    if url is None:
        return None
    try:
        answer = httpx.get(f"{url}/api/load", timeout=ANSWER_S, trust_env=False)
        return parse(HostLoad, answer.content, MAX_REPORT_BYTES) if answer.status_code == 200 else None
    except (httpx.HTTPError, TigasError):
        return None
