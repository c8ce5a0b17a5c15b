"""The commands `tigas cluster up` and `status`. Heavy imports wait until a command runs."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Annotated

import typer

from tigas_common.cli import AllowHosts, AllowOrigins, in_a_sentence, log_to_stdout
from tigas_common.errors import StartError
from tigas_common.settings import load_settings
from tigas_common.terminal import make_console
from tigas_common.topology import PAGE

cluster = typer.Typer(help="Let several machines serve scenes under one address, with Ray.", no_args_is_help=True)


@cluster.command("up")
def up(
    render_options: Annotated[
        list[str] | None,
        typer.Argument(help="Options of every host's render service, after --, such as: -- --memory-gb 40"),
    ] = None,
    scenes: Annotated[Path | None, typer.Option(help="Models directory, at the same place on every machine.")] = None,
    hosts: Annotated[
        str | None, typer.Option(metavar="N|MIN..MAX", help="How many hosts there may be.", show_default="1..64")
    ] = None,
    http: Annotated[
        str | None, typer.Option(metavar="HOST:PORT", help="Page and API.", show_default=str(PAGE.loopback))
    ] = None,
    resource: Annotated[
        str | None, typer.Option(metavar="NAME", help="Ray's resource that makes a machine a host.", show_default="GPU")
    ] = None,
    host_http_port: Annotated[
        int | None, typer.Option(metavar="PORT", help="Each host's API.", show_default="any free one")
    ] = None,
    host_quic_port: Annotated[
        int | None,
        typer.Option(metavar="PORT", help="Each host's WebTransport.", show_default="any free one"),
    ] = None,
    calm_minutes: Annotated[
        float | None, typer.Option(help="A host drains once fewer were enough for so long.", show_default="5")
    ] = None,
    grace_minutes: Annotated[
        float | None, typer.Option(help="How long viewers may stay on a host that drains.", show_default="10")
    ] = None,
    allow_hosts: AllowHosts = None,
    allow_origins: AllowOrigins = None,
) -> None:
    """Serve scenes from all machines of a Ray cluster until Ctrl+C: open the printed URL.

    RAY_ADDRESS names the cluster, of which this machine is one; without it, Ray is started on this machine alone.
    Settings are also read from table `cluster` of tigas.toml (or the file that TIGAS_CONFIG names) and TIGAS_CLUSTER_*.
    """
    flags = dict(locals())
    options = flags.pop("render_options") or []
    with in_a_sentence(StartError):
        from tigas_cluster.connection import check_ray

        check_ray()
        from tigas_cluster.settings import ClusterSettings

        settings = load_settings(ClusterSettings, flags)
        from tigas_cluster.up import up as run

        log_to_stdout()
        logging.getLogger("httpx").setLevel(logging.WARNING)  # hosts are asked all the time
        run(settings, options)


@cluster.command("status")
def status(
    json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Print how each host is."""
    with in_a_sentence(StartError):
        from tigas_cluster.connection import check_ray

        check_ray()
        from tigas_cluster.status import status as ask
        from tigas_cluster.status import table

        found = ask()
    if json:
        import json as format

        print(format.dumps([each.model_dump(mode="json") for each in found], indent=2))
    else:
        make_console().print(table(found) if found else "No host runs.")
